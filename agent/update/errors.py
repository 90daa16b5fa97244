"""The error of the updater."""

from radron.agent.errors import RadronError


class UpdateError(RadronError):
    """Why there is no update, in one line."""
