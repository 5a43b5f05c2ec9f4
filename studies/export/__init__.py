"""Controllers in C: writing them, and measuring whether they are the policies they were made of."""
