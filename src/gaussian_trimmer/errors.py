"""The exception for what only the user can mend."""


class InputError(ValueError):
    """An input cannot be used; the message is one sentence that says why and what to do.

    The command line prints the message and exits with code 2; every other exception is a defect of this package.
    """
