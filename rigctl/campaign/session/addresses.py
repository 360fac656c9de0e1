"""Which instrument an address means, however it is spelled: what a program holds to be alone with it."""

from __future__ import annotations

import ipaddress
import re
import socket
import stat
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

RESOLVE_S = 2.0
"""How long a host name may take; a name that nobody knows by then stands for itself."""

THIS_MACHINE = "this machine"
# Registered with IANA; a resource may name another.
HISLIP_PORT = 4880
# Keysight's instruments: the same interpreter behind both, once raw and once with echo and prompt.
SCPI_TELNET_PORT, SCPI_PORT = 5024, 5025
# 65535 is VISA's way to say that a GPIB device has no secondary address.
NO_SECONDARY = ("", "65535")


@dataclass(frozen=True, order=True)
class Claim:
    """Something a program holds, alone or, when `shared`, together with others that share it."""

    name: str
    shared: bool = False


Claims = frozenset[Claim]


def claims_of(address: str) -> Claims:
    """What has to be held to be alone with the instrument at `address`.

    Two spellings of one instrument have a claim in common that one of them does not share. Nothing is connected; a
    host name is looked up within `RESOLVE_S`. What is no address at all stands for itself.
    """
    text = address.strip()
    scheme, _, rest = text.partition(":")
    try:
        match scheme.lower():
            case "tcp":
                return _of_socket(*_host_and_port(_without_options(rest)))
            case "serial":
                return _of_device(_without_options(rest))
            case "visa":
                return _of_resource(_without_options(rest))
            case _:
                return _of_resource(_without_options(text))
    # Unknown to us is not unusable: pyvisa may know it. Equal spellings at least exclude each other.
    except ValueError:
        return frozenset({Claim(text.casefold())})


def conflict(ours: Claims, theirs: Claims) -> bool:
    """True when both cannot be held by different programs at once."""
    shared = {claim.name: claim.shared for claim in ours}
    return any(claim.name in shared and not (claim.shared and shared[claim.name]) for claim in theirs)


def _without_options(text: str) -> str:
    return text.partition("?")[0]


def _host_and_port(target: str) -> tuple[str, int]:
    host, _, port = target.strip("/").rpartition(":")
    return host, int(port)


def _of_resource(name: str) -> Claims:
    """A VISA resource name; `ValueError` when its kind is not known here."""
    first, *fields = name.split("::")
    kind = fields.pop().upper() if fields and fields[-1].upper() in {"INSTR", "SOCKET"} else "INSTR"
    known = re.fullmatch(r"(TCPIP|VICP|GPIB|ASRL|USB)(.*)", first, re.IGNORECASE)
    match known and known[1].upper(), fields:
        case "TCPIP", [host, port] if kind == "SOCKET":
            return _of_socket(host, int(port))
        case "TCPIP", [host, *device]:
            return _of_lan_device(host, "".join(device).lower() or "inst0")
        case "VICP", [host]:
            return _of_lan_device(host, "inst0")
        case "GPIB", [primary, *secondary] if known:
            return _of_gpib(int(known[2] or 0), int(primary), "".join(secondary))
        case "ASRL", [] if known and not known[2].isdecimal():
            return _of_device(known[2])
        case "USB", [maker, model, serial, *_]:
            return frozenset({Claim(f"usb {int(maker, 0)} {int(model, 0)} {serial.casefold()}")})
    raise ValueError(name)


def _of_socket(host: str, port: int) -> Claims:
    hosts = _hosts(host)
    # On this machine both may be simulators of different instruments.
    if port == SCPI_TELNET_PORT and THIS_MACHINE not in hosts:
        port = SCPI_PORT
    return _claims(hosts, Claim("sockets", shared=True), Claim(f"port {port}"))


def _of_lan_device(host: str, device: str) -> Claims:
    """VXI-11 or HiSLIP. What a gateway has behind it is named by the device; else the host is the instrument."""
    interface = re.fullmatch(r"(?:inst|hislip)(\d*)(?:,(\d+))?", device)
    hosts = _hosts(host)
    if interface is None:
        return _claims(hosts, Claim(f"device {device}"))
    number, port = int(interface[1] or 0), int(interface[2] or HISLIP_PORT)
    if port != HISLIP_PORT or (interface[2] and THIS_MACHINE in hosts):
        return _claims(hosts, Claim("sockets", shared=True), Claim(f"port {port}"))
    if number:
        # A gateway numbers what is behind it; 0 is the instrument itself, which also owns the host's sockets.
        return _claims(hosts, Claim(f"device {number}"))
    return _claims(hosts, Claim("sockets"), Claim("device 0"))


def _of_gpib(board: int, primary: int, secondary: str) -> Claims:
    name = f"gpib {board} {primary}"
    if secondary in NO_SECONDARY:
        return frozenset({Claim(name)})
    # Two secondary addresses may be used by two programs, but not one of them and the device as a whole.
    return frozenset({Claim(name, shared=True), Claim(f"{name} {int(secondary)}")})


def _of_device(path: str) -> Claims:
    """A serial line: its number in the kernel, which all its names and links lead to, and the name as written."""
    if not path:
        raise ValueError(path)
    names = {f"device {path}", f"device {Path(path).resolve()}"}
    with suppress(OSError):
        status = Path(path).stat()
        if Path(path).resolve().parent == PSEUDO_TERMINALS:  # numbers are given again as soon as they are free
            names = {f"pseudo-terminal {status.st_rdev} made {status.st_ctime_ns}"}
        elif stat.S_ISCHR(status.st_mode):
            names.add(f"character device {status.st_rdev}")
    return frozenset(map(Claim, names))


def _claims(hosts: Iterable[str], *parts: Claim) -> Claims:
    return frozenset(Claim(f"{host} {part.name}", part.shared) for host in hosts for part in parts)


def _hosts(name: str) -> set[str]:
    """Every address of a host, all of this machine's as one; its name too, for who cannot look it up."""
    plain = name.strip("[]").rstrip(".").lower()
    if not plain:
        raise ValueError(name)
    # The name itself is claimed too, for programs that cannot look it up while this one can.
    return {plain, *(THIS_MACHINE if _is_this_machine(ip) else str(ip) for ip in _looked_up(plain))}


PSEUDO_TERMINALS = Path("/dev/pts")

IpAddress = ipaddress.IPv4Address | ipaddress.IPv6Address


def _looked_up(host: str) -> set[IpAddress]:
    resolved: list[str] = []

    def ask() -> None:
        with suppress(OSError, UnicodeError):
            resolved.extend(str(entry[4][0]) for entry in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM))

    # getaddrinfo knows no time-out; a daemon thread may hang on a dead name server and delay nobody.
    asking = Thread(target=ask, daemon=True, name=f"look up {host}")
    asking.start()
    asking.join(RESOLVE_S)
    # A copy: the thread may still append when the time is up.
    return {_plain(ipaddress.ip_address(text)) for text in tuple(resolved)}


def _plain(ip: IpAddress) -> IpAddress:
    # ::ffff:10.0.0.1 is the host 10.0.0.1.
    return getattr(ip, "ipv4_mapped", None) or ip


def _is_this_machine(ip: IpAddress) -> bool:
    """True for loopback and for an interface's address: what would go there sets out from there. Sends nothing."""
    if ip.is_loopback or ip.is_unspecified:
        return True
    family = socket.AF_INET if ip.version == 4 else socket.AF_INET6
    with suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
        # For UDP this only chooses the route and sends nothing; 9 is the discard port, and any would do.
        probe.connect((str(ip), 9))
        # An IPv6 link-local address may carry its interface after a %.
        return str(probe.getsockname()[0]).partition("%")[0] == str(ip).partition("%")[0]
    return False
