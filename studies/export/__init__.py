"""Export of controllers to C and ONNX, and their comparison with Python."""
