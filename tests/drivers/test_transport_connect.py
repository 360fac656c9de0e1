"""Addresses: what an operator may write, and what is said about what they may not."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connect import connector
from rigctl.core.clock import RealClock
from rigctl.core.errors import ConfigError

CLOCK = RealClock()


@pytest.mark.parametrize(
    "address",
    [
        "tcp://192.168.0.254:5001",
        "tcp://xps-d.local:1",
        "serial:/dev/ttyUSB0",
        "serial:/dev/ttyUSB0?baud=921600&parity=E&bytesize=7&stopbits=1.5&rtscts=1&xonxoff=0",
        "TCPIP0::192.168.0.10::5025::SOCKET",
        "TCPIP::192.168.0.10::hislip0,4880::INSTR",
        "GPIB0::22::INSTR",
        "ASRL/dev/ttyS0::INSTR?baud=115200",
        "visa:TCPIP::dmm::inst0::INSTR?backend=@ivi",
        "visa:ASRL1::INSTR?backend=@ivi&baud=19200",
    ],
)
def test_good_addresses_open_nothing_yet(address: str) -> None:
    assert callable(connector(address, CLOCK))


@pytest.mark.parametrize(
    ("address", "mend"),
    [
        ("", "write tcp://host:port, serial:"),
        ("/dev/ttyUSB0", "write tcp://host:port, serial:"),
        ("xps:5001", "write tcp://host:port, serial:"),
        ("tcp:host:5001", "write tcp://host:port"),
        ("tcp://host", "write tcp://host:port"),
        ("tcp://:5001", "write tcp://host:port"),
        ("tcp://host:0", "port 1 to 65535"),
        ("tcp://host:65536", "port 1 to 65535"),
        ("tcp://host:5001?x", "write tcp://host:port"),
        ("serial:", "no device"),
        ("serial:?baud=9600", "no device"),
        ("serial:/dev/ttyS0?baud", "key=value"),
        ("serial:/dev/ttyS0?baud=", "option baud cannot be ''"),
        ("serial:/dev/ttyS0?baud=fast", "option baud cannot be 'fast'"),
        ("serial:/dev/ttyS0?baud=0", "option baud cannot be '0'"),
        ("serial:/dev/ttyS0?parity=X", "option parity cannot be 'X'"),
        ("serial:/dev/ttyS0?bytesize=9", "option bytesize cannot be '9'"),
        ("serial:/dev/ttyS0?rtscts=yes", "option rtscts cannot be 'yes'"),
        ("serial:/dev/ttyS0?speed=9600", "unknown option 'speed'; known: baud"),
        ("serial:/dev/ttyS0?rtscts=1&xonxoff=1", "one flow control"),
        ("GPIB0::22::INSTR?baud=9600", "baud is for serial lines only"),
        ("visa:", "is not understood"),
        ("sim:", "simulated instrument has no wire"),
    ],
)
def test_bad_addresses_say_in_one_line_what_to_write(address: str, mend: str) -> None:
    with pytest.raises(ConfigError) as caught:
        connector(address, CLOCK)
    message = str(caught.value)
    assert repr(address) in message
    assert mend in message
    assert "\n" not in message


@given(st.text(max_size=40) | st.from_regex(r"(tcp://|serial:|visa:|TCPIP|ASRL|sim:)[\w:?=&,/.]*", fullmatch=True))
def test_any_text_is_an_address_or_a_config_error(address: str) -> None:
    try:
        message = repr(connector(address, CLOCK))
    except ConfigError as error:
        message = str(error)
    assert len(message.splitlines()) == 1
