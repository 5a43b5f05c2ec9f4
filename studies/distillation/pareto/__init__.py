"""How small can formulas be and still walk: closed-loop reward against size."""
