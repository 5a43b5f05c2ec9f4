"""What the robot, the task and the policies are: pure, batch-first functions and data files."""
