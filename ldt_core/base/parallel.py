"""The same function on many items: in processes here, or on a Dask cluster.

joblib computes, on a cluster by its own Dask backend. What it lacks is here: whether the workers
have the same LDT, exceptions of a cluster's tasks, and an end of workers whose parent was killed.

Results do not depend on where they were computed or in how many processes: each worker computes an
item in one thread, as this process would.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.metadata
import os
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Generic, Self, TypeVar

from joblib import Parallel, cpu_count, delayed, parallel_config
from threadpoolctl import threadpool_limits

from ldt_core.base.errors import BadInput

Item = TypeVar("Item")
Answer = TypeVar("Answer")

SCHEDULER_TIMEOUT = 10  # s, for a scheduler to answer
PACKAGE = "ldt"


class Workers:
    """Processes that compute; a context, at whose end they are gone.

    Args:
        jobs: processes on this machine; 0 takes one for each core that this process may use.
        scheduler: address of a Dask scheduler (tcp://host:port), whose workers compute instead;
            "" computes here.
        identity: what has to be the same on all workers as here (a version, say).

    Raises:
        BadInput: on entering, no scheduler at that address, or one whose workers cannot do this.
    """

    def __init__(
        self, jobs: int = 0, scheduler: str = "", identity: Callable[[], Any] | None = None
    ) -> None:
        self.jobs = jobs or cpu_count()
        self.scheduler = scheduler
        self.identity = identity
        self._client: Any = None

    def __enter__(self) -> Self:
        if self.scheduler:
            self._client = _connect(self.scheduler)
            try:
                _check_workers(self._client, self.scheduler, self.identity)
            except BaseException:
                self._client.close()
                raise
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._client is not None:
            self._client.close()
        elif self.jobs > 1:
            from joblib.externals.loky import get_reusable_executor

            # After a failure or Ctrl-C nobody waits for what a worker is in the middle of.
            get_reusable_executor().shutdown(wait=True, kill_workers=kind is not None)

    def map(
        self, function: Callable[[Item], Answer], items: Sequence[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """(item, function of it), as they come; begun in the order of the items.

        Args:
            function: importable by its name (workers import it too), of one item.
            items: that can be pickled, as their answers.

        Raises:
            Exception: what the function raised, at once; what else is running is given up.
        """
        if not items:
            return
        local = self._client is None and self.jobs > 1
        guarded = _Guarded(function, os.getpid() if local else None)
        tasks = (delayed(guarded)(index, item) for index, item in enumerate(items))
        with self._backend():
            # Runs take seconds: one is a batch, so that none waits for another.
            answers = Parallel(return_as="generator_unordered", batch_size=1)(tasks)
            try:
                for index, answer, error in answers:
                    if error is not None:
                        raise error
                    yield items[index], answer
            finally:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # joblib's, of tasks given up on purpose
                    answers.close()

    def _backend(self) -> contextlib.AbstractContextManager[Any]:
        if self._client is not None:
            return parallel_config(backend="dask", client=self._client)
        if self.jobs == 1:
            return parallel_config(backend="sequential")
        return parallel_config(backend="loky", n_jobs=self.jobs, inner_max_num_threads=1)


class _Guarded(Generic[Item, Answer]):
    """The function as a worker calls it: in one thread, its failure an answer like any other.

    (joblib's Dask backend tells nobody of an exception when results are taken as they come.)
    """

    def __init__(self, function: Callable[[Item], Answer], parent: int | None) -> None:
        self.function, self.parent = function, parent

    def __call__(self, index: int, item: Item) -> tuple[int, Answer | None, Exception | None]:
        if self.parent is not None:
            _end_with(self.parent)
        try:
            with threadpool_limits(1):
                return index, self.function(item), None
        except Exception as error:  # raised again by whoever asked
            return index, None, error


@functools.cache
def _end_with(parent: int) -> None:
    """End this process when its parent is gone (killed, it could not say goodbye)."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _connect(address: str) -> Any:
    try:
        from distributed import Client
        from distributed.comm.addressing import parse_address
        from distributed.comm.registry import backends
    except ImportError:
        raise BadInput(
            "scheduler", "the extra `cluster` (pip install 'ldt[cluster]')", "no Dask here"
        ) from None
    try:
        scheme, _ = parse_address(address)  # before anything is started for it
        if scheme not in backends:
            raise ValueError(scheme)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of other versions: `identity` decides
            return Client(address, timeout=SCHEDULER_TIMEOUT, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        got = type(error).__name__ if isinstance(error, ValueError) else "none that answers"
        raise BadInput("scheduler", f"a Dask scheduler at {address}", got) from error


def _check_workers(client: Any, address: str, identity: Callable[[], Any] | None) -> None:
    where = f"scheduler {address}"
    if not client.nthreads():
        raise BadInput(where, "at least one worker", "none")
    try:
        client.run(importlib.metadata.version, PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        raise BadInput(where, "LDT installed on every worker", "one without") from None
    if identity is None:
        return
    try:
        there = client.run(identity)
    except Exception as error:  # an older LDT may lack the very function
        raise BadInput(where, "the same LDT on every worker", f"{error}") from error
    here = identity()
    for worker, found in there.items():
        if found != here:
            raise BadInput(f"{where}, worker {worker}", f"{here}", f"{found}")
