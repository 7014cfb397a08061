"""The last models that came, by version: one may come before the adaptation that names it."""

from __future__ import annotations

from typing import Generic, TypeVar

from ldt_core.base.bounded import forget_oldest

T = TypeVar("T")

#: As many as the topic holds for late joiners, and some that come meanwhile.
KEPT_VERSIONS = 12


class ModelVersions(Generic[T]):
    """Models by version, bounded; `first`, that of version 0, stays known."""

    def __init__(self, first: T) -> None:
        self.first = first
        self._models: dict[int, T] = {}

    def put(self, version: int, model: T) -> None:
        """Take in a model; an adaptor that begins anew counts its versions from 0 again."""
        self._models.pop(version, None)
        self._models[version] = model
        forget_oldest(self._models, KEPT_VERSIONS)

    def get(self, version: int) -> T | None:
        """The model of a version; None where it has not come, or long ago."""
        found = self._models.get(version)
        return self.first if found is None and version == 0 else found

    @property
    def last(self) -> T:
        """The model that came last."""
        return next(reversed(self._models.values()), self.first)
