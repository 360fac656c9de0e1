"""A Qt class for the LK-G5000 (github.com/ugurmengilli/keyence-lk-g5000) on an LK-G5000.

C++ with Qt 5 and its serial port, made here with g++, moc and a few lines that call it. RIGCTL_LKG5000_QT names a
checkout.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from simulators.keyence_lkg import SimulatedLkg5000
from simulators.wiring import TriggerLine
from tests.clients.conftest import Serve

CHECKOUT = os.environ.get("RIGCTL_LKG5000_QT")


def _qt_is_there() -> bool:
    if not all(shutil.which(tool) for tool in ("g++", "moc", "pkg-config")):
        return False
    return subprocess.run(["pkg-config", "--exists", "Qt5SerialPort"], check=False).returncode == 0


pytestmark = [
    pytest.mark.skipif(CHECKOUT is None, reason="RIGCTL_LKG5000_QT names no checkout of keyence-lk-g5000"),
    pytest.mark.skipif(not _qt_is_there(), reason="there is no g++ with moc and Qt5SerialPort"),
]

# One value, then its modes as raw commands: each is sent when the one before is answered.
CALLS = """
#include <QCoreApplication>
#include <QStringList>
#include <QTimer>
#include <cstdio>
#include "lkg5000.h"

int main(int count, char **arguments)
{
    QCoreApplication application(count, arguments);
    LkG5000 laser(1);
    laser.setPortName(arguments[1]);
    laser.setBaudRate();
    if (!laser.open())
        return 2;
    QStringList commands = {"Q0", "SW,CA,8", "SR,CA", "R0"};
    auto next = [&] {
        if (commands.isEmpty())
            return application.quit();
        laser.writeCommand(commands.takeFirst().toLatin1());
    };
    QObject::connect(&laser, &LkG5000::measurementReady, [&] {
        std::printf("%.4f", laser.getMeasuredValues().last());
        QObject::connect(&laser, &LkG5000::dataReady, [&] {
            std::printf(" %s", qPrintable(laser.getResponse()));
            next();
        });
        next();
    });
    QTimer::singleShot(30000, [&] { application.exit(3); });
    laser.measure();
    return application.exec();
}
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    assert CHECKOUT is not None
    directory = tmp_path_factory.mktemp("lkg5000")
    (directory / "calls.cc").write_text(CALLS)
    theirs = Path(CHECKOUT) / "libLkG5000"
    meta = directory / "moc_lkg5000.cc"
    subprocess.run(["moc", theirs / "lkg5000.h", "-o", meta], check=True)
    flags = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "Qt5SerialPort", "Qt5Core"], capture_output=True, text=True, check=True
    ).stdout.split()
    made = directory / "calls"
    sources = [directory / "calls.cc", meta, theirs / "lkg5000.cpp"]
    subprocess.run(["g++", "-w", "-fPIC", f"-I{theirs}", "-o", made, *sources, *flags], check=True)
    return made


def test_it_measures_and_changes_modes(serve: Serve, program: Path) -> None:
    heads = [lambda t: np.full_like(t, -3.0625)]
    address = serve(lambda clock: SimulatedLkg5000(clock, heads, TriggerLine()), "serial")
    done = subprocess.run([program, address.device], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "-3.0625 Q0 SW,CA SR,CA,8 R0"
