"""Runtime assurance: the student acts inside of its region, the expert outside."""
