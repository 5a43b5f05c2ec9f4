"""How small can formulas be and still walk: closed-loop return against size."""
