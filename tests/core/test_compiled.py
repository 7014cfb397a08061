"""Compiled code comes out of numba's cache without the compiler, and is the same code."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from ldt_core.base import compiled

#: A function of a file, called as it comes out of the cache; says what of numba was loaded.
CALL = """
import json, sys
sys.path.insert(0, {folder!r})
import ldt_core.base.compiled as compiled
{change}
import of_a_file
value = of_a_file.area(2.0)
hits = sum(of_a_file.area.stats.cache_hits.values())
print(json.dumps([value, hits, "numba.typed.listobject" in sys.modules]))
"""
SOURCE = """
import numpy as np
from ldt_core.base.compiled import njit

@njit()
def area(side):
    return np.full(3, side).sum() * np.sin(side)
"""
#: The same without an array, which is half of the time to compile, where only files matter.
PLAIN = """
from ldt_core.base.compiled import njit

@njit()
def area(side):
    return side * side
"""
#: Loads all of LDT's functions that are cached, with all their types, before any is compiled.
LOAD_ALL = """
import importlib, pkgutil, sys
import ldt_core
from numba.core.registry import CPUDispatcher

loaded = 0
for module in pkgutil.walk_packages(ldt_core.__path__, "ldt_core."):
    if "compiled" not in open(importlib.util.find_spec(module.name).origin).read():
        continue
    for found in vars(importlib.import_module(module.name)).values():
        if isinstance(found, CPUDispatcher) and hasattr(found._cache, "_cache_file"):
            for key in found._cache._cache_file._load_index():
                loaded += found._cache.load_overload(key[0], found.targetctx) is not None
assert "numba.typed.listobject" not in sys.modules
print(loaded)
"""


def _python(program: str) -> str:
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def _called(folder: Path, change: str = "") -> tuple[float, int, bool]:
    value, hits, prepared = json.loads(_python(CALL.format(folder=str(folder), change=change)))
    return value, hits, prepared


def _called_here(folder: Path) -> tuple[float, int]:
    """The same in this process, where the compiler is ready: nothing is known of a call before."""
    spec = importlib.util.spec_from_file_location("of_a_file", folder / "of_a_file.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.area(2.0), sum(module.area.stats.cache_hits.values())


@pytest.mark.slow
def test_what_is_cached_runs_without_the_compiler_and_gives_the_same(tmp_path: Path) -> None:
    """Compiled the first time, loaded the second; an untried numba loads as numba does."""
    (tmp_path / "of_a_file.py").write_text(SOURCE)
    value, hits, prepared = _called(tmp_path)
    assert (hits, prepared) == (0, True)
    assert _called(tmp_path) == (value, 1, False)
    untried = "compiled._Cache = compiled.FunctionCache"
    assert _called(tmp_path, untried) == (value, 1, True)


@pytest.mark.slow
def test_every_function_of_ours_can_be_loaded_so() -> None:
    """One that asked for what only the compiler registers would end the process."""
    _python("from ldt_core.cli import ldt; ldt(['run', '--experiments', '1', '--no-bag'])")
    assert int(_python(LOAD_ALL)) >= 3


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_a_cache_that_a_power_failure_cut_is_made_anew(suffix: str, tmp_path: Path) -> None:
    """Cut, or other bytes: numba failed at it, at every start from then on."""
    (tmp_path / "of_a_file.py").write_text(PLAIN)
    value, _ = _called_here(tmp_path)
    (file,) = tmp_path.rglob(f"*{suffix}")
    whole = file.read_bytes()
    for damaged in (whole[:-9], bytes(len(whole))):
        file.write_bytes(damaged)
        assert _called_here(tmp_path) == (value, 0)
    assert _called_here(tmp_path) == (value, 1)


@pytest.mark.slow
def test_a_cache_on_a_full_disk_costs_time_alone(tmp_path: Path) -> None:
    """The run ended, without the name of the folder that is full."""
    (tmp_path / "of_a_file.py").write_text(PLAIN)
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))"
    value, hits, _ = _called(tmp_path, limit)
    assert (_called_here(tmp_path), hits) == ((value, 0), 0)


def test_the_numba_that_is_installed_by_constraints_is_the_one_that_was_tried() -> None:
    """Whoever renews the constraints has to try the cache again, by the two tests above."""
    pinned = (Path(__file__).parents[2] / "constraints.txt").read_text().splitlines()
    assert f"numba=={compiled.TRIED}" in pinned
    assert numba.__version__ != compiled.TRIED or compiled._Cache is compiled._ReadyCache


@pytest.mark.slow
def test_the_first_run_on_a_computer_says_what_it_waits_for(tmp_path: Path) -> None:
    """Once on standard error, and not where the cache has everything."""
    told = []
    for out in ("first", "second"):
        command = [sys.executable, "-m", "ldt_core", "simulate", "--machine", "dc_motor"]
        command += ["--experiments", "1", "--out", out]
        surroundings = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        ran = subprocess.run(
            command, cwd=tmp_path, env=surroundings, capture_output=True, text=True, check=True
        )
        told.append(ran.stderr.splitlines())
    assert len(told[0]) == 1
    assert told[0][0].startswith("compiling numerical code that is new on this computer")
    assert told[1] == []
