"""The error of the updater."""

from radron.agent.errors import RadronError


class UpdateError(RadronError):
    """An update was refused or failed; the text gives the reason in one line."""
