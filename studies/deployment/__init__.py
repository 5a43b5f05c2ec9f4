"""Taking a controller to a robot: as a file of C or ONNX, and over LCM."""
