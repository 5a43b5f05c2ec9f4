"""Assembly: the station, the closed locomotion loop, the batch simulator and their pictures."""
