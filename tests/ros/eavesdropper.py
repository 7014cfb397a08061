"""Hears every datagram of an interface, and sends what it heard elsewhere.

python eavesdropper.py hear DEVICE SECONDS            prints one JSON line a datagram, then "end";
                                                      a SIGTERM ends it before the time
python eavesdropper.py join ADDRESS GROUP SECONDS     is a member of the group there, as any DDS is
python eavesdropper.py forge ADDRESS SECONDS FILE     sends the payloads of the file, in turns
"""

from __future__ import annotations

import json
import signal
import socket
import struct
import sys
import time
from pathlib import Path

IPV4, UDP, OUTGOING = 0x0800, 17, 4  # OUTGOING: on lo every datagram is seen twice


def hear(device: str, seconds: float) -> None:
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x0003)) as ear:
        ear.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 23)
        ear.bind((device, 0))
        ear.settimeout(0.1)
        told_to_end: list[int] = []
        signal.signal(signal.SIGTERM, lambda number, _: told_to_end.append(number))
        print("hearing", flush=True)
        end = time.monotonic() + seconds
        while time.monotonic() < end and not told_to_end:
            try:
                frame, (_, kind, way, *_) = ear.recvfrom(65535)
            except TimeoutError:
                continue
            if device == "lo" and way == OUTGOING:
                continue
            told = {"kind": kind, "from": None, "to": None, "port": None, "data": ""}
            packet = frame[14:]
            if kind == IPV4 and len(packet) >= 20:
                told["from"] = socket.inet_ntoa(packet[12:16])
                told["to"] = socket.inet_ntoa(packet[16:20])
                head = 4 * (packet[0] & 15)
                first = struct.unpack(">H", packet[6:8])[0] & 0x1FFF == 0
                if packet[9] == UDP and first and len(packet) >= head + 8:
                    told["port"] = struct.unpack(">H", packet[head + 2 : head + 4])[0]
                    told["data"] = packet[head + 8 :].hex()
            print(json.dumps(told), flush=True)
    print("end", flush=True)


def join(address: str, group: str, seconds: float) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as member:
        both = socket.inet_aton(group) + socket.inet_aton(address)
        member.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, both)
        print("joined", flush=True)
        time.sleep(seconds)


def forge(address: str, seconds: float, file: str) -> None:
    found = json.loads(Path(file).read_text())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address))
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for data in found["payloads"]:
                for target in found["targets"]:
                    out.sendto(bytes.fromhex(data), tuple(target))
            time.sleep(0.05)


if __name__ == "__main__":
    does, *given = sys.argv[1:]
    if does == "hear":
        hear(given[0], float(given[1]))
    elif does == "join":
        join(given[0], given[1], float(given[2]))
    else:
        forge(given[0], float(given[1]), given[2])
