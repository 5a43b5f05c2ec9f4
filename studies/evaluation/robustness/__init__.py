"""Where policies fall: the expert and every student alone, in every world."""
