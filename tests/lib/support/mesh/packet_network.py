"""Hosts in network namespaces, their packets passing through a process that can lose, delay, reorder, duplicate and corrupt them.

``python packet_network.py COUNT SEED``, as root: hosts 1 to COUNT in namespaces of their own, ``HUB`` in the caller's.
The process says "up"; each line of its input then sets the state of all links between two hosts of the namespaces
(``LinkState`` as JSON).
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from random import Random

import msgspec

from radron.sim.live.relays.linkstate import LinkState, Packets

HUB = 254
_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
READ_BYTES = 65_536


def address(host: int) -> str:
    return f"10.77.0.{host}"


def namespace(pid: int, host: int) -> str:
    """Name of a host's namespace; ``pid``: of the process that runs the network."""
    return f"radron-{pid}-{host}"


@contextmanager
def packet_network(count: int, seed: int) -> Iterator[tuple[list[str], list[list[str]], Callable[[LinkState], None]]]:
    """A running network: the hosts' addresses, the beginning of a command on each, and what sets the state of all links."""
    command = [sys.executable, __file__, str(count), str(seed)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None
    assert process.stdout is not None
    orders = process.stdin

    def impair(state: LinkState) -> None:
        orders.write(msgspec.json.encode(state).decode() + "\n")
        orders.flush()

    hosts = range(1, count + 1)
    try:
        assert process.stdout.readline() == "up\n"
        yield [address(host) for host in hosts], [["ip", "netns", "exec", namespace(process.pid, host)] for host in hosts], impair
    finally:
        process.stdin.close()
        process.wait()
        process.stdout.close()


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


class PacketNetwork:
    """The hosts' TUN devices, and the forwarding between them."""

    def __init__(self, count: int, seed: int) -> None:
        self._devices: dict[bytes, int] = {}  # open TUN device by the host's address
        self._hosts = [*range(1, count + 1), HUB]
        self._links: dict[tuple[bytes, bytes], Packets] = {}
        self._seed = seed

    def open(self) -> None:
        for host in self._hosts:
            name = f"rt{os.getpid() % 100_000}x{host}"
            device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
            fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH", name.encode(), _IFF_TUN | _IFF_NO_PI))
            here = host == HUB
            inside: tuple[str, ...] = ()
            if not here:
                ip("netns", "add", namespace(os.getpid(), host))
                ip("link", "set", name, "netns", namespace(os.getpid(), host))
                inside = ("-n", namespace(os.getpid(), host))
                ip(*inside, "link", "set", "lo", "up")
            ip(*inside, "addr", "add", f"{address(host)}/24", "dev", name)
            ip(*inside, "link", "set", name, "up")
            self._devices[bytes(map(int, address(host).split(".")))] = device

    def impair(self, state: LinkState) -> None:
        hub = bytes(map(int, address(HUB).split(".")))
        for sender in self._devices:
            for receiver in self._devices:
                if hub not in (sender, receiver):
                    self._link(sender, receiver).state = state

    def _link(self, sender: bytes, receiver: bytes) -> Packets:
        if (sender, receiver) not in self._links:
            self._links[sender, receiver] = Packets(Random(f"{self._seed} {sender.hex()} {receiver.hex()}"))
        return self._links[sender, receiver]

    def listen(self) -> None:
        for device in self._devices.values():
            asyncio.get_running_loop().add_reader(device, self._forward, device)

    def _forward(self, device: int) -> None:
        loop = asyncio.get_running_loop()
        for _ in range(64):
            try:
                packet = os.read(device, READ_BYTES)
            except BlockingIOError:
                return
            sender, receiver = packet[12:16], packet[16:20]  # of an IPv4 header
            target = self._devices.get(receiver)
            if packet[0] >> 4 != 4 or target is None:
                continue
            now_s = loop.time()
            for due_s, copy in self._link(sender, receiver).carry(packet, now_s):
                if due_s <= now_s:
                    self._write(target, copy)
                else:
                    loop.call_at(due_s, self._write, target, copy)

    def _write(self, device: int, packet: bytes) -> None:
        with suppress(OSError):  # a full queue, or not a packet any more: lost
            os.write(device, packet)

    def close(self) -> None:
        for device in self._devices.values():
            os.close(device)
        for host in self._hosts[:-1]:
            with suppress(subprocess.CalledProcessError):
                ip("netns", "del", namespace(os.getpid(), host))


async def _run(count: int, seed: int) -> None:
    network = PacketNetwork(count, seed)
    orders = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(orders), sys.stdin)
    try:
        network.open()
        network.listen()
        print("up", flush=True)
        while line := await orders.readline():
            network.impair(msgspec.json.decode(line, type=LinkState))
    finally:
        network.close()


if __name__ == "__main__":
    asyncio.run(_run(int(sys.argv[1]), int(sys.argv[2])))
