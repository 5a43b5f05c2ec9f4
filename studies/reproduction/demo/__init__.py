"""The whole road in minutes: the shipped expert, distilled quickly, compared and shown."""
