"""Are the claims that a policy of formulas makes true of the robot?"""
