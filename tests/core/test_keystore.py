"""A keystore by which every role may do its own work and no other, held against openssl and XML."""

from __future__ import annotations

import datetime
import json
import os
import shutil
import stat
import subprocess
from fnmatch import fnmatchcase
from pathlib import Path
from xml.etree import ElementTree

import pytest

import msgs_config
from ldt_core.base.errors import BadInput, LdtError
from ldt_core.cli import invoke, ldt

pytest.importorskip("cryptography")

from ldt_core.security.certificates import new_authority
from ldt_core.security.keystore import FILES, check_keystore, make_keystore
from ldt_core.security.permissions import LISTENERS, NODES, OPERATOR, ROLES, publishers

ALONE = (*LISTENERS, OPERATOR)  # enclaves of no machine's own
DOMAIN = 7
NAMESPACES = ["", "hall/press"]
TOPICS = msgs_config.topics()


@pytest.fixture(scope="module")
def keystore(tmp_path_factory) -> Path:
    """Of two machines."""
    folder = tmp_path_factory.mktemp("security") / "keys"
    make_keystore(folder, NAMESPACES, DOMAIN, streams=["/hall/press/axis/joint_states"])
    return folder


def enclaves(keystore: Path) -> list[str]:
    """Names of all that are there."""
    root = keystore / "enclaves"
    return sorted(f"/{f.parent.relative_to(root)}" for f in root.rglob("key.pem"))


def openssl(*arguments: str | Path) -> subprocess.CompletedProcess[bytes]:
    if not shutil.which("openssl"):
        pytest.skip("no openssl")
    return subprocess.run(["openssl", *map(str, arguments)], capture_output=True, check=False)


def allowed(document: bytes) -> dict[str, dict[str, list[str]]]:
    """Subject → verb → topics, of permissions without anything that is not understood here."""
    root = ElementTree.fromstring(document)
    found = {}
    for grant in root.iterfind("permissions/grant"):
        assert [e.tag for e in grant] == ["subject_name", "validity", "allow_rule", "default"]
        assert grant.findtext("default") == "DENY"
        rule = grant.find("allow_rule")
        assert [e.tag for e in rule] == ["domains", "publish", "subscribe"]
        assert [(e.tag, e.text) for e in rule.find("domains")] == [("id", str(DOMAIN))]
        found[grant.findtext("subject_name")] = {
            verb: [t.text for t in rule.iterfind(f"{verb}/topics/topic")]
            for verb in ("publish", "subscribe")
        }
    return found


@pytest.fixture(scope="module")
def signed(keystore: Path) -> dict[str, dict[str, list[str]]]:
    """What the signed permissions of each enclave say, once openssl has verified them."""
    found = {}
    for name in enclaves(keystore):
        place = keystore / "enclaves" / name.strip("/")
        authority = place / "permissions_ca.cert.pem"
        done = openssl(
            "smime", "-verify", "-text", "-in", place / "permissions.p7s", "-CAfile", authority
        )
        assert done.returncode == 0, done.stderr
        plain = (place / "permissions.xml").read_bytes()
        assert done.stdout.replace(b"\r\n", b"\n") == plain
        (subject,) = (of := allowed(done.stdout))
        assert subject == f"CN={name}"
        found[name] = of[subject]
    return found


# ---- what is in it


def test_every_role_of_every_machine_has_an_enclave(keystore):
    """Those who listen to all machines have one for all."""
    below = [f"/{n}" if n else "" for n in NAMESPACES]
    wanted = {f"{b}/{role}" for b in below for role in NODES} | {f"/{r}" for r in ALONE}
    assert set(enclaves(keystore)) == wanted
    for name in wanted:
        assert all((keystore / "enclaves" / name.strip("/") / f).is_file() for f in FILES)


@pytest.mark.slow
def test_openssl_follows_every_certificate_to_the_authority(keystore):
    """And not to another one; the subject is the enclave, the key is on P-256 and fits."""
    stranger = keystore.parent / "stranger"
    make_keystore(stranger, [""], DOMAIN)
    for name in enclaves(keystore):
        place = keystore / "enclaves" / name.strip("/")
        certificate = place / "cert.pem"
        authority = place / "identity_ca.cert.pem"
        good = openssl("verify", "-CAfile", authority, certificate)
        assert good.returncode == 0, good.stderr
        bad = openssl("verify", "-CAfile", stranger / "public" / "ca.cert.pem", certificate)
        assert bad.returncode != 0
    shown = openssl("x509", "-in", certificate, "-noout", "-subject", "-ext", "basicConstraints")
    assert f"CN = {name}".encode() in shown.stdout
    assert b"CA:FALSE" in shown.stdout
    key = openssl("pkey", "-in", place / "key.pem", "-pubout").stdout
    assert key == openssl("x509", "-in", certificate, "-noout", "-pubkey").stdout
    text = openssl("pkey", "-in", place / "key.pem", "-noout", "-text").stdout
    assert b"prime256v1" in text


def test_for_each_topic_those_may_publish_who_are_declared_to_and_nobody_else(signed):
    """By name and by pattern, in the documents that openssl has verified."""
    for topic in TOPICS:
        for namespace in [""] if topic.startswith("/") else NAMESPACES:
            below = f"/{namespace}" if namespace else ""
            full = f"rt{topic}" if topic.startswith("/") else f"rt{below}/{topic}"
            may = {
                name
                for name, of in signed.items()
                if any(fnmatchcase(full, pattern) for pattern in of["publish"])
            }
            bases = [f"/{n}" if n else "" for n in NAMESPACES]
            everywhere = bases if topic.startswith("/") else [below]
            roles = [*TOPICS[topic]["publisher"], *TOPICS[topic].get("may_publish", [])]
            assert may == {f"{b}/{role}" for b in everywhere for role in roles}, full
    assert publishers("model") == ["adaptor"]
    assert publishers("experiment") == ["plant", "player", "segmenter"]


def test_nobody_may_do_anything_that_is_not_declared(signed):
    """No pattern in a topic's name; a machine hears nothing of another one."""
    for name, of in signed.items():
        for verb, topics in of.items():
            for topic in topics:
                if "*" in topic:  # the node's own answers on its parameters
                    kind, end = ("rr", "Reply") if verb == "publish" else ("rq", "Request")
                    assert topic.startswith(f"{kind}/")
                    assert topic.endswith(f"/*{end}")
                    assert topic.split("/")[-2] == name.rpartition("/")[2]
        machine = name.rpartition("/")[0]
        if name.strip("/") not in LISTENERS:
            others = [n for n in NAMESPACES if n and f"/{n}" != machine]
            reached = [t for t in of["subscribe"] for n in others if t.startswith(f"rt/{n}/")]
            assert reached == [] or name.endswith("/segmenter")
    assert "rt/hall/press/axis/joint_states" in signed["/hall/press/segmenter"]["subscribe"]


def test_the_operator_alone_may_ask_an_adaptor_to_learn_or_not(signed):
    """Of every machine, and publish nothing else; what it did the adaptor may say."""
    for namespace in NAMESPACES:
        node = f"{namespace}/adaptor" if namespace else "adaptor"
        asks, hears = f"rq/{node}/change_stateRequest", f"rr/{node}/change_stateReply"
        may = [n for n, of in signed.items() if any(fnmatchcase(asks, p) for p in of["publish"])]
        assert may == ["/operator"]
        assert hears in signed["/operator"]["subscribe"]
        assert f"rt/{node}/transition_event" in signed[f"/{node}"]["publish"]
    sent = [t for t in signed["/operator"]["publish"] if not t.startswith(("rq/", "rr/operator/"))]
    assert set(sent) == {"rt/rosout", "rt/parameter_events", "ros_discovery_info"}


def test_governance_lets_nobody_in_who_is_not_known(keystore):
    """Signed; everything authenticated, access-controlled and encrypted."""
    file = keystore / "enclaves" / "governance.p7s"
    done = openssl(
        "smime", "-verify", "-text", "-in", file, "-CAfile", keystore / "public" / "ca.cert.pem"
    )
    assert done.returncode == 0, done.stderr
    (rule,) = ElementTree.fromstring(done.stdout).iter("domain_rule")
    values = {e.tag: e.text for e in rule.iter() if not len(e)}
    assert values.pop("topic_expression") == "*"
    assert values.pop("id") == str(DOMAIN)
    assert values.pop("allow_unauthenticated_participants") == "false"
    assert set(values.values()) == {"true", "ENCRYPT"}
    assert len(values) == 10


def test_a_changed_permission_is_not_signed(keystore, tmp_path):
    """One letter."""
    place = keystore / "enclaves" / "twin"
    data = (place / "permissions.p7s").read_bytes()
    forged = tmp_path / "forged.p7s"
    forged.write_bytes(data.replace(b"rt/prediction", b"rt/experiment", 1))
    assert forged.read_bytes() != data
    done = openssl("smime", "-verify", "-in", forged, "-CAfile", place / "permissions_ca.cert.pem")
    assert done.returncode != 0


def test_keys_are_their_owner_s_alone(keystore):
    """Whatever the umask; certificates and permissions are for everybody."""
    made = [keystore.parent / "lax", keystore.parent / "strict"]
    for folder, mask in zip(made, (0, 0o077), strict=True):
        before = os.umask(mask)
        try:
            make_keystore(folder, [""], DOMAIN)
        finally:
            os.umask(before)
    for folder in (keystore, *made):
        keys = [*folder.rglob("key.pem"), folder / "private" / "ca.key.pem"]
        assert {stat.S_IMODE(k.stat().st_mode) for k in keys} == {0o600}
        assert stat.S_IMODE((folder / "private").stat().st_mode) == 0o700
        assert stat.S_IMODE((folder / "public" / "ca.cert.pem").stat().st_mode) == 0o644
        assert stat.S_IMODE((folder / "enclaves" / "twin").stat().st_mode) == 0o755


def test_links_stay_in_the_keystore(keystore, tmp_path):
    """It can be moved and copied as a whole."""
    moved = tmp_path / "elsewhere"
    shutil.copytree(keystore, moved, symlinks=True)
    for link in (f for f in moved.rglob("*") if f.is_symlink()):
        assert not os.readlink(link).startswith("/")
        assert link.resolve(strict=True).is_relative_to(moved.resolve())


# ---- making it


def test_nothing_is_overwritten_and_nothing_half_made_is_left(tmp_path, monkeypatch):
    """A folder, a file or a dangling link in its place; a disk that is full on the way."""
    link = tmp_path / "link"
    link.symlink_to("nowhere")
    (tmp_path / "folder").mkdir()
    for name in ("link", "folder"):
        with pytest.raises(BadInput, match="a folder that does not exist yet"):
            make_keystore(tmp_path / name)
    from ldt_core.security import keystore as module

    def full(file: Path, *_: object) -> None:
        raise OSError(28, "No space left on device", str(file))

    before = set(tmp_path.iterdir())
    monkeypatch.setattr(module, "_write", full)
    with pytest.raises(LdtError, match=r"cannot be written .No space left"):
        make_keystore(tmp_path / "new")
    assert set(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    "wrong",
    [
        {"namespaces": ["../up"]},
        {"namespaces": ["a b"]},
        {"namespaces": ["a<b"]},
        {"namespaces": ["x" * 60]},
        {"domain": 233},
        {"domain": -1},
        {"days": 0},
        {"streams": ["relative"]},
        {"streams": ["/a/*"]},
        {"streams": ["/"]},
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(wrong, tmp_path):
    """Before anything is written."""
    with pytest.raises(BadInput, match=r"^[a-z ]+: expected "):
        make_keystore(tmp_path / "keys", **wrong)
    assert not list(tmp_path.iterdir())


def test_a_namespace_may_be_called_as_a_role(tmp_path):
    """A folder is then an enclave and holds others."""
    made = make_keystore(tmp_path / "keys", ["plant", "", "plant/"])
    assert len(made.enclaves) == 2 * len(NODES) + len(ALONE)
    assert {"/plant", "/plant/plant"} <= set(enclaves(tmp_path / "keys"))


def test_the_command_says_what_it_made(tmp_path, capsys, monkeypatch):
    """As JSON with everything; the domain is the environment's."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    assert invoke(ldt, ["security", "init", "--namespace", "press", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["keystore"] == "ldt_keystore"
    assert told["domain"] == 42
    assert set(told["enclaves"]) == set(enclaves(tmp_path / "ldt_keystore"))
    assert "rt/press/model" in told["enclaves"]["/press/adaptor"]["publishes"]
    assert invoke(ldt, ["security", "init", "--out", "other"]) == 0
    told = capsys.readouterr().out
    assert "/adaptor" in told
    assert "/model" in told
    assert invoke(ldt, ["security", "init"]) == 2
    assert "ldt_keystore: expected a folder that does not exist" in capsys.readouterr().err


def test_a_domain_of_the_environment_that_cannot_be_is_refused(tmp_path, capsys, monkeypatch):
    """The sentence names the variable, as `ldt up` does."""
    monkeypatch.setenv("ROS_DOMAIN_ID", "233")
    assert invoke(ldt, ["security", "init", "--out", str(tmp_path / "keys")]) == 2
    assert "ROS_DOMAIN_ID: expected a whole number from 0 to 232" in capsys.readouterr().err


# ---- looking at it before use


def test_a_sound_keystore_is_taken(keystore):
    """For all roles of a machine in its domain."""
    names = [f"/hall/press/{role}" for role in NODES] + ["/monitor"]
    assert check_keystore(keystore, names, DOMAIN) == keystore.absolute()


def test_an_unsound_one_is_refused_in_a_sentence(keystore, tmp_path):
    """Not there, another machine's, a lost file, a key for all, another domain, out of date."""
    copy = tmp_path / "copy"
    shutil.copytree(keystore, copy, symlinks=True)
    with pytest.raises(BadInput, match="no folder enclaves in it"):
        check_keystore(tmp_path / "nothing", ["/twin"], DOMAIN)
    with pytest.raises(BadInput, match="with the enclave /lathe/twin"):
        check_keystore(copy, ["/lathe/twin"], DOMAIN)
    with pytest.raises(BadInput, match="for the ROS domain 8"):
        check_keystore(copy, ["/twin"], 8)
    (copy / "enclaves/twin/key.pem").chmod(0o640)
    with pytest.raises(BadInput, match=r"chmod 600 .*key\.pem.*got mode 640"):
        check_keystore(copy, ["/twin"], DOMAIN)
    (copy / "public/ca.cert.pem").unlink()
    with pytest.raises(BadInput, match=r"none with the file identity_ca\.cert\.pem"):
        check_keystore(copy, ["/hall/press/twin"], DOMAIN)
    (tmp_path / "copy/enclaves/detector/cert.pem").write_text("nothing")
    shutil.copy(keystore / "public/ca.cert.pem", copy / "public/ca.cert.pem")
    with pytest.raises(BadInput, match="a certificate"):
        check_keystore(copy, ["/detector"], DOMAIN)

    began = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=30)
    old = new_authority("old", began, began + datetime.timedelta(days=10)).certify("/adaptor")
    (copy / "enclaves/adaptor/cert.pem").write_bytes(old.certificate_pem)
    with pytest.raises(BadInput, match=r"a certificate that is valid now .*, got one from 20"):
        check_keystore(copy, ["/adaptor"], DOMAIN)


def test_every_role_that_is_declared_is_known():
    """A role that topics.yaml names and that has no enclave could not run secured."""
    keys = ("publisher", "subscriber", "may_publish", "may_listen")
    named = {role for declared in TOPICS.values() for key in keys for role in declared.get(key, ())}
    assert named == set(ROLES) - {OPERATOR}
