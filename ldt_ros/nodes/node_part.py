"""What a node is composed of."""

from __future__ import annotations

from typing import Any


class NodePart:
    """Tells its health with that of its node, and ends with it."""

    #: Longest time that a process waits for `quiet` when it is told to stop [s].
    patience = 0.0

    @property
    def quiet(self) -> bool:
        """Whether nothing is under way that others wait for."""
        return True

    def health(self) -> dict[str, Any]:
        """Values for `/diagnostics`, by name."""
        return {}

    def complaint(self) -> str:
        """What a person should look at, in a sentence; "" when all is well."""
        return ""

    def halt(self) -> None:
        """Begin no new work: the process has been told to stop."""
