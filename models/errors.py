"""The error that a person's input raises, to be told in one sentence."""


class InputError(Exception):
    """A file, key or argument that a person gave cannot be used; the message says how to mend it.

    Command lines print the message alone and exit with code 2. It is no ValueError: tyro would
    frame the sentence with its own.
    """
