"""Who may publish and hear what in a graph, derived from `msgs_config/topics.yaml`, as XML.

DDS-Security 1.1 (OMG formal/2018-04-01), 9.4.1: governance says how a domain is protected, and each
participant brings its permissions; both are signed by an authority that all know. Topics have the
names that ROS 2 gives them in DDS: `rt/` before a topic, `rq/` and `rr/` before a service.
"""

from __future__ import annotations

import datetime
import os
import re
from dataclasses import dataclass
from xml.etree import ElementTree as Xml

import msgs_config
from ldt_core.base.errors import BadInput

#: Nodes of one machine's graph, an enclave each below the machine's namespace.
NODES = (
    *("plant", "player", "segmenter", "twin", "detector", "adaptor"),
    *("diagnoser", "advisor", "recorder"),
)
#: Who listens to all machines at once, and sends nothing that a machine's nodes act on.
LISTENERS = ("monitor", "watch")
#: Who may switch the learning of each machine off and on, and nothing else.
OPERATOR = "operator"
ROLES = (*NODES, *LISTENERS, OPERATOR)
#: Services by which an operator switches the adaptor, a managed node.
LIFECYCLE_SERVICES = ("change_state", "get_state")
#: Topic on which the adaptor tells that it was switched.
LIFECYCLE_EVENT = "transition_event"
#: Of ROS_DOMAIN_ID; Fast DDS computes port numbers from it, and ends the process above 232.
DOMAINS = range(233)
#: ROS 2's limit of a topic's name, 247 characters, without the longest service of a node.
MOST_NAMESPACE = 247 - len("/adaptor/get_available_transitionsRequest")
NAMESPACE = re.compile(r"/?([A-Za-z_]\w*(/[A-Za-z_]\w*)*)?/?", re.ASCII)
#: Every node's own: its log and what it tells of its parameters; and which nodes there are.
EVERYONE_PUBLISHES = ("rt/rosout", "rt/parameter_events", "ros_discovery_info")
EVERYONE_HEARS = ("ros_discovery_info",)
_SCHEMA = "http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_{}.xsd"
_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
_DATE = "%Y-%m-%dT%H:%M:%S"  # without a zone it is UTC


@dataclass(frozen=True)
class Enclave:
    """What the processes of one role may do.

    Args:
        name: absolute, "/press/adaptor"; the subject of its certificate.
    """

    name: str
    publishes: tuple[str, ...]
    hears: tuple[str, ...]


def publishers(topic: str) -> list[str]:
    """The roles that may publish a declared topic, whatever a graph consists of."""
    declared = msgs_config.topics()[topic]
    return [*declared["publisher"], *declared.get("may_publish", ())]


def listeners(topic: str) -> list[str]:
    """The roles that may hear a declared topic."""
    declared = msgs_config.topics()[topic]
    return [*declared["subscriber"], *declared.get("may_listen", ())]


def domain_of_environment() -> int:
    """ROS_DOMAIN_ID, or 0.

    Raises:
        BadInput: it cannot be a domain.
    """
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (text.isascii() and text.isdigit() and len(text) < 10 and int(text) in DOMAINS):
        raise BadInput("ROS_DOMAIN_ID", f"a whole number from 0 to {DOMAINS[-1]}", repr(text[:20]))
    return int(text)


def check_namespace(namespace: str) -> str:
    """A namespace without the slashes at its ends.

    Raises:
        BadInput: ROS could not have such a one, or none of its topics.
    """
    if len(namespace) > MOST_NAMESPACE:
        raise BadInput("namespace", f"at most {MOST_NAMESPACE} characters", len(namespace))
    if not NAMESPACE.fullmatch(namespace):
        words = "words of letters, digits and underscores, joined by slashes"
        raise BadInput("namespace", words, repr(namespace))
    return namespace.strip("/")


def enclaves(namespaces: list[str], streams: list[str]) -> list[Enclave]:
    """One enclave for each node of each machine, and one for each of those who listen to all.

    Args:
        namespaces: of the machines' topics, "" for the root.
        streams: further topics that the segmenters hear, a machine's own; absolute names.
    """
    found = [_node(role, namespace, streams) for namespace in namespaces for role in NODES]
    return [*found, *(_listener(role, namespaces) for role in LISTENERS), _operator(namespaces)]


def enclave_name(role: str, namespace: str) -> str:
    """The enclave in which a role's process runs."""
    alone = role not in NODES or not namespace.strip("/")
    return f"/{role}" if alone else f"/{namespace.strip('/')}/{role}"


def _node(role: str, namespace: str, streams: list[str]) -> Enclave:
    publishes = [_dds(t, namespace) for t in msgs_config.topics() if role in publishers(t)]
    hears = [_dds(t, namespace) for t in msgs_config.topics() if role in listeners(t)]
    if role == "adaptor":
        publishes.append(_dds(f"{role}/{LIFECYCLE_EVENT}", namespace))
    if role == "segmenter":
        hears += [f"rt/{topic.strip('/')}" for topic in streams]
    return _enclave(role, [namespace], publishes, hears)


def _listener(role: str, namespaces: list[str]) -> Enclave:
    topics = [t for t in msgs_config.topics() if role in listeners(t)]
    hears = [_dds(t, namespace) for namespace in namespaces for t in topics]
    return _enclave(role, ["", *namespaces], [], hears)


def _operator(namespaces: list[str]) -> Enclave:
    adaptors = [f"{_prefix(namespace)}adaptor" for namespace in namespaces]
    asked = [f"{adaptor}/{name}" for adaptor in adaptors for name in LIFECYCLE_SERVICES]
    publishes = [f"rq/{name}Request" for name in asked]
    hears = [f"rr/{name}Reply" for name in asked]
    return _enclave(OPERATOR, [""], publishes, hears)


def _enclave(role: str, namespaces: list[str], publishes: list[str], hears: list[str]) -> Enclave:
    # A node answers questions after its parameters, which are read-only; nobody may ask.
    nodes = [f"{_prefix(namespace)}{role}" for namespace in namespaces]
    publishes = [*publishes, *EVERYONE_PUBLISHES, *(f"rr/{node}/*Reply" for node in nodes)]
    hears = [*hears, *EVERYONE_HEARS, *(f"rq/{node}/*Request" for node in nodes)]
    name = enclave_name(role, namespaces[0])
    return Enclave(name, tuple(dict.fromkeys(publishes)), tuple(dict.fromkeys(hears)))


def _prefix(namespace: str) -> str:
    return f"{namespace}/" if namespace else ""


def _dds(topic: str, namespace: str) -> str:
    return f"rt{topic}" if topic.startswith("/") else f"rt/{_prefix(namespace)}{topic}"


# ---- XML


def governance_xml(domain: int) -> str:
    """Who is not authenticated stays outside; all is encrypted, as SROS 2 has it by default."""
    root = _root("governance")
    rule = Xml.SubElement(Xml.SubElement(root, "domain_access_rules"), "domain_rule")
    _domain(rule, domain)
    _leaves(
        rule,
        allow_unauthenticated_participants="false",
        enable_join_access_control="true",
        discovery_protection_kind="ENCRYPT",
        liveliness_protection_kind="ENCRYPT",
        rtps_protection_kind="ENCRYPT",
    )
    topic = Xml.SubElement(Xml.SubElement(rule, "topic_access_rules"), "topic_rule")
    _leaves(
        topic,
        topic_expression="*",
        enable_discovery_protection="true",
        enable_liveliness_protection="true",
        enable_read_access_control="true",
        enable_write_access_control="true",
        metadata_protection_kind="ENCRYPT",
        data_protection_kind="ENCRYPT",
    )
    return _text(root)


def permissions_xml(
    enclave: Enclave, domain: int, begin: datetime.datetime, end: datetime.datetime
) -> str:
    """What an enclave may do, and nothing else.

    Args:
        domain: the only one in which it may do it.
        begin: from when on [UTC].
        end: until when [UTC].
    """
    root = _root("permissions")
    grant = Xml.SubElement(Xml.SubElement(root, "permissions"), "grant", name=enclave.name)
    _leaves(grant, subject_name=f"CN={enclave.name}")
    validity = Xml.SubElement(grant, "validity")
    _leaves(validity, not_before=begin.strftime(_DATE), not_after=end.strftime(_DATE))
    rule = Xml.SubElement(grant, "allow_rule")
    _domain(rule, domain)
    for verb, names in (("publish", enclave.publishes), ("subscribe", enclave.hears)):
        topics = Xml.SubElement(Xml.SubElement(rule, verb), "topics")
        for name in names:
            Xml.SubElement(topics, "topic").text = name
    _leaves(grant, default="DENY")
    return _text(root)


def _root(kind: str) -> Xml.Element:
    place = {f"{{{_INSTANCE}}}noNamespaceSchemaLocation": _SCHEMA.format(kind)}
    Xml.register_namespace("xsi", _INSTANCE)
    return Xml.Element("dds", place)


def _domain(rule: Xml.Element, domain: int) -> None:
    Xml.SubElement(Xml.SubElement(rule, "domains"), "id").text = str(domain)


def _leaves(parent: Xml.Element, **texts: str) -> None:
    for name, text in texts.items():
        Xml.SubElement(parent, name).text = text


def _text(root: Xml.Element) -> str:
    Xml.indent(root)
    return Xml.tostring(root, encoding="UTF-8", xml_declaration=True).decode() + "\n"
