"""Every table and figure of the paper, made anew from the shipped experts."""
