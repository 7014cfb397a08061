"""Whether an adaptor learns at present, as the operator wants it, kept beside the recording.

So that it outlives a crash of the adaptor, and the end of the whole stack.
"""

from __future__ import annotations

from pathlib import Path

#: File that is there while nothing is to be learned.
NAME = "learning.off"


class LearningSwitch:
    """What the operator wants.

    Args:
        folder: of the recording; "" where there is none, so that nothing is kept.
    """

    def __init__(self, folder: str | Path) -> None:
        self._file = Path(folder) / NAME if str(folder) else None

    @property
    def is_off(self) -> bool:
        """Whether nothing is to be learned."""
        return self._file is not None and self._file.exists()

    def turn(self, off: bool) -> bool:
        """Note what the operator wants; whether it could be noted."""
        if self._file is None:
            return False
        try:
            if off:
                self._file.touch()
            else:
                self._file.unlink(missing_ok=True)
        except OSError:
            return False
        return True
