"""Controllers in C and ONNX: writing them, and measuring whether they are the same policies."""
