"""A controller and a robot in two processes: run, and measured."""
