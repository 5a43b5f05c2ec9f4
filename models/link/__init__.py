"""The link between a robot's process and its controller's: messages, and what to do without them.

The types in `messages` are made from `messages.lcm` by LCM's tool.
"""
