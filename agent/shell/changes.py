"""What begins and ends among the problems of a kind, logged and told."""

from __future__ import annotations

from collections.abc import Callable

from agent.shell.logs import Logger


class Changes:
    """Tells the problems of one kind when they change, and logs each once when it begins and when it is over."""

    def __init__(self, kind: str, log: Logger) -> None:
        self._kind, self._log = kind, log
        self._told: tuple[str, ...] = ()

    def tell(self, problems: tuple[str, ...], to: Callable[[tuple[str, ...]], None]) -> None:
        """Tell all problems of this kind that there are now, if they differ from those of the last call."""
        before, self._told = self._told, problems
        if problems == before:
            return
        to(problems)
        for text in problems:
            if text not in before:
                self._log.warning(self._kind, text=text)
        for text in before:
            if text not in problems:
                self._log.info(f"{self._kind} is over", text=text)
