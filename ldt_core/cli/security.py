"""`ldt security`: a keystore by which every node may do its own work and no other."""

from __future__ import annotations

from typing import Any

import click

from ldt_core.cli.options import json_option
from ldt_core.cli.outputs import check_file, force_option
from ldt_core.cli.spelling import SuggestingGroup
from ldt_core.cli.terminal import echo, echo_json, echo_result


@click.group(
    "security", cls=SuggestingGroup, short_help="Keys that restrict what each node may publish."
)
def command() -> None:
    """Create the keys and permissions that DDS-Security needs.

    Example: ldt security init
    """


@command.command("init", short_help="Make a keystore with an enclave for each role.")
@click.option(
    "-o",
    "--out",
    default="ldt_keystore",
    show_default=True,
    help="Folder of the keystore, which must not exist.",
)
@click.option(
    "--namespace",
    "namespaces",
    multiple=True,
    help="Namespace of a machine's topics; can be given several times. By default none.",
)
@click.option(
    "--stream-topic",
    "streams",
    multiple=True,
    metavar="TOPIC",
    help="Topic of the machine that the segmenter reads; can be given several times.",
)
@click.option(
    "--domain",
    type=int,
    default=None,
    help="ROS domain in which it is valid; by default ROS_DOMAIN_ID, or 0.",
)
@click.option(
    "--days",
    type=click.IntRange(1, 36500),
    default=3650,
    show_default=True,
    help="Days of validity.",
)
@json_option
def init(
    out: str,
    namespaces: tuple[str, ...],
    streams: tuple[str, ...],
    domain: int | None,
    days: int,
    as_json: bool,
) -> None:
    """Write a keystore in the layout of SROS 2.

    It contains an authority and, for each role in a graph, an enclave with a key, a certificate and
    signed permissions. Only the adaptor may publish the model. Only plant, player and segmenter may
    publish experiments; a machine that publishes them itself uses the plant's enclave. Keys are
    readable only by their owner. The folder `private` is needed only to create further enclaves:
    store it elsewhere.

    Example: ldt security init --out keys --namespace press
    """
    from ldt_core.security.keystore import make_keystore
    from ldt_core.security.permissions import domain_of_environment

    number = domain_of_environment() if domain is None else domain
    made = make_keystore(out, list(namespaces), number, days, list(streams))
    if as_json:
        found: dict[str, Any] = {
            "keystore": str(made.folder),
            "domain": made.domain,
            "valid_until": made.end.isoformat(),
            "enclaves": {
                e.name: {"publishes": list(e.publishes), "hears": list(e.hears)}
                for e in made.enclaves
            },
        }
        echo_json(found)
        return
    width = max(len(e.name) for e in made.enclaves)
    for enclave in made.enclaves:
        own = [t for t in enclave.publishes if t.startswith("rt/") and t not in _OF_ALL]
        told = ", ".join(t.removeprefix("rt") for t in own) or "nothing"
        echo(f"{enclave.name:{width}}  may publish {told}")
    echo(f"{made.folder}: valid in ROS domain {made.domain} until {made.end:%Y-%m-%d}")
    echo(f"ldt up --secure {made.folder} runs in it, where the middleware can.")


@command.command("sbom", short_help="What LDT consists of here, for scanners.")
@click.option("-o", "--out", required=True, help="File of the bill of materials: .json.")
@force_option
@json_option
def sbom(out: str, force: bool, as_json: bool) -> None:
    """Write a bill of materials: LDT and every library that it needs and that is installed.

    A CycloneDX 1.5 document, with versions and licences, the extras' and the embedded ones too.
    Nothing is asked over a network.

    Example: ldt security sbom -o ldt.cdx.json
    """
    import json
    from pathlib import Path

    from ldt_core.base.result_files import write
    from ldt_core.security.bill_of_materials import bill

    check_file(out, force, endings=(".json",))
    made = bill()
    write(Path(out), json.dumps(made, indent=1) + "\n")
    record = {"out": out, "components": len(made["components"])}
    echo_result(as_json, record, f"{record['components']} components: {out}")


_OF_ALL = ("rt/rosout", "rt/parameter_events")
