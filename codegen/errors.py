"""The errors a user can meet, each with the exit status the command line gives for it.

Every message reads ``where: what (found, expected). What to do.``
"""


class ResiduaError(Exception):
    """Base of all errors that are the user's to see; printed as one line, without a traceback."""

    exit_code = 1


class PlantError(ResiduaError):
    """The plant file is wrong."""

    exit_code = 3


class DesignError(ResiduaError):
    """No design of the asked kind exists for this plant; says which mode and entry obstructs."""

    exit_code = 4


class CertificateError(ResiduaError):
    """The exact check refuses the constants; says which condition, which mode, by how much."""

    exit_code = 5


class EmitError(ResiduaError):
    """The C could not be written."""

    exit_code = 6


class ToolError(ResiduaError):
    """A tool outside Python (gcc, ...) is missing or failed."""

    exit_code = 6


class ValidationError(ResiduaError):
    """The compiled C ran, and did not do what the design promises."""

    exit_code = 7
