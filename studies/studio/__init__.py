"""The studio: formulas are changed while a robot walks by them."""
