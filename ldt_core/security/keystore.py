"""A keystore in the layout of SROS 2: made once, whole or not at all, and looked at before use.

The package sros2 is in no wheel, and takes permissions from a running graph or from files by hand.
Here they follow from the table of topics.

public/      certificates of the authority
private/     its key: needed for nothing but further enclaves, so it belongs elsewhere
enclaves/    governance, and a folder for each enclave: key, certificate, permissions
"""

from __future__ import annotations

import contextlib
import datetime
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ldt_core.base.errors import BadInput, LdtError
from ldt_core.security.permissions import (
    DOMAINS,
    Enclave,
    check_namespace,
    enclaves,
    governance_xml,
    permissions_xml,
)

if TYPE_CHECKING:
    from ldt_core.security.certificates import Authority

AUTHORITY = "ldt_ca"  # subject of its certificate
VALID_DAYS = 3650  # that a keystore is valid, as SROS 2 has it
CLOCK_TOLERANCE = datetime.timedelta(days=1)  # it is valid so much earlier: hosts' clocks differ
#: In each enclave's folder; the last three point to what all have in common.
FILES = (
    *("key.pem", "cert.pem", "permissions.p7s"),
    *("governance.p7s", "identity_ca.cert.pem", "permissions_ca.cert.pem"),
)
KEY_MODE = 0o600
PRIVATE_MODE = 0o700  # of the folder with the authority's key
FOLDER_MODE = 0o755
MAX_NAMESPACES = 100  # machines of one keystore
MAX_ENCLAVE_NAME = 64  # characters, of a common name in X.509


@dataclass(frozen=True)
class Keystore:
    """What has been made."""

    folder: Path
    enclaves: list[Enclave]
    domain: int
    end: datetime.datetime


def make_keystore(
    folder: str | Path,
    namespaces: list[str] | None = None,
    domain: int = 0,
    days: int = VALID_DAYS,
    streams: list[str] | None = None,
) -> Keystore:
    """Write a new keystore.

    Args:
        folder: which must not exist.
        namespaces: of the machines; None for one without.
        domain: ROS domain in which it is to be valid.
        days: that it is to be valid.
        streams: topics of a machine's own that its segmenter hears, absolute.

    Raises:
        BadInput: a folder that exists, or names, a domain or days that cannot be.
        LdtError: no cryptography library, or it cannot be written.
    """
    from ldt_core.security.certificates import new_authority

    target = Path(folder)
    found = _planned(target, namespaces or [""], domain, days, streams or [])
    now = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
    authority = new_authority(AUTHORITY, now - CLOCK_TOLERANCE, now + datetime.timedelta(days=days))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise LdtError(f"{target}: cannot be written ({error.strerror})") from error
    try:
        _fill(work, authority, found, domain)
        _refuse_existing(target)
        os.rename(work, target)
    except OSError as error:
        raise LdtError(f"{target}: cannot be written ({error.strerror})") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return Keystore(target, found, domain, authority.end)


def _fill(work: Path, authority: Authority, found: list[Enclave], domain: int) -> None:
    """Write everything into a new folder that nobody else may look into yet."""
    for name in ("public", "private", "enclaves"):
        (work / name).mkdir()
    _write(work / "private" / "ca.key.pem", authority.identity.key_pem, KEY_MODE)
    _write(work / "public" / "ca.cert.pem", authority.identity.certificate_pem)
    for kind in ("identity", "permissions"):
        (work / "public" / f"{kind}_ca.cert.pem").symlink_to("ca.cert.pem")
        (work / "private" / f"{kind}_ca.key.pem").symlink_to("ca.key.pem")
    governance = governance_xml(domain)
    _write(work / "enclaves" / "governance.xml", governance.encode())
    _write(work / "enclaves" / "governance.p7s", authority.sign(governance))
    for enclave in found:
        place = work / "enclaves" / enclave.name.strip("/")
        place.mkdir(parents=True, exist_ok=True)  # a namespace may be called as a role
        identity = authority.certify(enclave.name)
        permissions = permissions_xml(enclave, domain, authority.begin, authority.end)
        _write(place / "key.pem", identity.key_pem, KEY_MODE)
        _write(place / "cert.pem", identity.certificate_pem)
        _write(place / "permissions.xml", permissions.encode())
        _write(place / "permissions.p7s", authority.sign(permissions))
        up = Path(*[".."] * enclave.name.count("/"))
        (place / "governance.p7s").symlink_to(up / "governance.p7s")
        for kind in ("identity", "permissions"):
            name = f"{kind}_ca.cert.pem"
            (place / name).symlink_to(up / ".." / "public" / name)
    for place in (f for f in work.rglob("*") if f.is_dir()):
        place.chmod(FOLDER_MODE)  # whatever the umask
    (work / "private").chmod(PRIVATE_MODE)
    work.chmod(FOLDER_MODE)


def _planned(
    target: Path, namespaces: list[str], domain: int, days: int, streams: list[str]
) -> list[Enclave]:
    _refuse_existing(target)
    if domain not in DOMAINS:
        raise BadInput("domain", f"{DOMAINS[0]} to {DOMAINS[-1]}", domain)
    if days < 1:
        raise BadInput("days", "1 or more", days)
    names = list(dict.fromkeys(check_namespace(n) for n in namespaces))
    if len(names) > MAX_NAMESPACES:
        raise BadInput("namespace", f"at most {MAX_NAMESPACES}", len(names))
    for topic in streams:
        if not (topic.startswith("/") and check_namespace(topic)):
            raise BadInput("stream topic", "an absolute name, /press/joint_states", repr(topic))
    found = enclaves(names, streams)
    longest = max((e.name for e in found), key=len)
    if len(longest) > MAX_ENCLAVE_NAME:
        expected = f"a name by which no enclave has more than {MAX_ENCLAVE_NAME} characters"
        raise BadInput("namespace", expected, f"{longest}, which has {len(longest)}")
    return found


def _refuse_existing(target: Path) -> None:
    if os.path.lexists(target):
        raise BadInput(
            target, "a folder that does not exist yet, for the keystore", "one that does"
        )


def _write(file: Path, data: bytes, mode: int = 0o644) -> None:
    """A new file with this mode from the first moment on."""
    number = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(number, "wb") as out:
        out.write(data)
        os.fchmod(out.fileno(), mode)  # whatever the umask


def check_keystore(folder: str | Path, names: list[str], domain: int) -> Path:
    """Its absolute path, if the enclaves are there, private, valid now, and for the domain.

    Args:
        domain: ROS domain in which they are.

    Raises:
        BadInput: they are not; one sentence that says what to do.
        LdtError: no cryptography library.
    """
    keystore = Path(folder).absolute()
    advice = "(ldt security init makes one)"
    if not (keystore / "enclaves").is_dir():
        raise BadInput(folder, f"a keystore {advice}", "no folder enclaves in it")
    for name in names:
        place = keystore / "enclaves" / name.strip("/")
        missing = [f for f in FILES if not (place / f).is_file()]
        if missing:
            got = f"none with the file {missing[0]}"
            raise BadInput(folder, f"a keystore with the enclave {name} {advice}", got)
        key = place / "key.pem"
        mode = key.stat().st_mode & 0o777
        if mode & 0o077:
            expected = f"a key that its owner alone can read (chmod 600 {key})"
            raise BadInput(key, expected, f"mode {mode:03o}")
        _check_dates(place / "cert.pem")
        with contextlib.suppress(OSError):
            if f"<id>{domain}</id>" not in (place / "permissions.xml").read_text(errors="replace"):
                expected = f"permissions for the ROS domain {domain} {advice}"
                raise BadInput(place / "permissions.xml", expected, "those for another one")
    return keystore


def _check_dates(file: Path) -> None:
    from ldt_core.security.certificates import read_certificate

    now = datetime.datetime.now(datetime.UTC)
    try:
        certificate = read_certificate(file.read_bytes())
    except (ValueError, OSError) as error:
        raise BadInput(file, "a certificate", " ".join(str(error).split())) from None
    begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if not begin <= now <= end:
        expected = "a certificate that is valid now (ldt security init makes a new keystore)"
        raise BadInput(file, expected, f"one from {begin:%Y-%m-%d} to {end:%Y-%m-%d}")
