"""Files made to fill the memory, to wait for ever or to lead elsewhere: refused at once, in one line."""

import os
import re
import stat
import time
import tracemalloc
import zipfile
import zlib

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import read_bundle
from rigctl.core.bounds import COLUMNS

GIB = 1 << 30


def deflated(size, wbits):
    """A stream that unpacks to `size` zeros, made without packing them one by one."""
    packer = zlib.compressobj(9, wbits=wbits)
    first = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    return first + again * ((size >> 20) - 1) + packer.flush()


def packed(path, name, size, said):
    """A .zip whose member unpacks to `size` bytes, while its list of contents says `said`."""
    stream = deflated(size, -15)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(name, stream)
        (member,) = archive.infolist()
        member.compress_type, member.file_size = zipfile.ZIP_DEFLATED, said


def gz_of_zeros(path):
    (path / "runs/2.csv.gz").write_bytes(deflated(3 * GIB, 31)[:-4] + (3 * GIB).to_bytes(4, "little"))


def gz_that_hides_its_size(path):
    (path / "runs/2.csv.gz").write_bytes(deflated(4 * GIB, 31)[:-4] + bytes(4))


def npz_of_zeros(path):
    packed(path / "runs/2.npz", "t_s.npy", 3 * GIB, 3 * GIB)


def npz_that_hides_its_size(path):
    packed(path / "runs/2.npz", "t_s.npy", 3 * GIB, 1000)


def npz_that_promises(path):
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**15,)}
    with zipfile.ZipFile(path / "runs/2.npz", "w") as archive, archive.open("t_s.npy", "w") as file:
        np.lib.format.write_array_header_1_0(file, header)


def npz_of_a_million_columns(path):
    entry = b"PK\x01\x02" + bytes(24) + b"\x01" + bytes(17) + b"c"
    listed = entry * 1_000_000
    end = b"PK\x05\x06" + bytes(8) + len(listed).to_bytes(4, "little") + bytes(6)
    (path / "runs/2.npz").write_bytes(listed + end)


def csv_of_a_million_columns(path):
    (path / "runs/2.csv").write_text(",".join(f"c{i}" for i in range(1_000_000)) + "\n")


def csv_of_too_many_columns(path):
    (path / "runs/2.csv").write_text(",".join(f"c{i}" for i in range(COLUMNS + 1)) + "\n")


def csv_of_one_endless_row(path):
    (path / "runs/2.csv").write_text("t_s,stage_x_mm,accel_v\n" + '"\n",' * 2_000_000)


def sparse(path):
    with (path / "runs/2.csv").open("wb") as file:
        file.truncate(4 * GIB)


def header_of_deep_tables(path):
    (path / "recording.toml").write_text(f"format = 1\n{'a.' * 200_000}a = 1\n")


def header_of_deep_arrays(path):
    (path / "recording.toml").write_text(f"format = 1\na = {'[' * 100_000}{']' * 100_000}\n")


def header_of_a_deep_table(path):
    (path / "recording.toml").write_text(f"format = 1\n[{'.'.join('a' * 40)}]\n")


def header_of_a_huge_number(path):
    (path / "recording.toml").write_text(f"format = 1\nn = {'9' * 5000}\n")


def header_of_many_pages(path):
    (path / "recording.toml").write_text("# " + "x" * 5_000_000)


BOMBS = {
    gz_of_zeros: "runs/2.csv.gz: 3 GiB unpacked, but at most 1 GiB are read; write it as .npz",
    gz_that_hides_its_size: r"runs/2.csv.gz: \d+ MiB packed into .+ KiB, more than 100 to 1",
    npz_of_zeros: "runs/2.npz: 3 GiB packed into .+ MiB, more than 100 to 1",
    npz_that_hides_its_size: r"runs/2.npz: not readable arrays of numbers \(",
    npz_that_promises: "runs/2.npz: column t_s has 1000000000000000 samples, but at most",
    npz_of_a_million_columns: "runs/2.npz: (a list of contents of|1000000 files packed)",
    csv_of_a_million_columns: "runs/2.csv, line 1: longer than 1048576 characters",
    csv_of_too_many_columns: "runs/2.csv, line 1: 2001 columns, but at most 2000",
    csv_of_one_endless_row: "runs/2.csv, line .+: a row that does not end; mend the quotes",
    sparse: "runs/2.csv: 4 GiB, but at most 1 GiB are read",
    header_of_deep_tables: "recording.toml, line 2: 200000 dots in one line",
    header_of_deep_arrays: "recording.toml: nested deeper than 32",
    header_of_a_deep_table: "recording.toml: nested deeper than 32",
    header_of_a_huge_number: "recording.toml: ",
    header_of_many_pages: "recording.toml: 4.768 MiB, but at most 1 MiB",
}


@pytest.mark.parametrize("bomb", BOMBS, ids=lambda bomb: bomb.__name__)
def test_what_would_fill_the_memory_is_refused_at_once(refusal, sensing, bomb):
    if bomb.__name__.startswith(("gz", "npz")):
        sensing.tables.pop("runs/2.csv")
    bomb(sensing.write())
    tracemalloc.start()
    start = time.process_time()
    message = refusal(sensing.path)
    took_s = time.process_time() - start
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert re.match(f"night/{BOMBS[bomb]}", message), message
    assert took_s < 2.0  # a tenth of it without the tracing
    assert peak < 100e6


def test_a_zip_bomb_is_refused_before_it_is_unpacked(refusal, tmp_path):
    packed(tmp_path / "night.zip", "recording.toml", 3 * GIB, 3 * GIB)
    assert re.match(r"night.zip: 3 GiB packed into .+ MiB, more than 100 to 1", refusal(tmp_path / "night.zip"))


@pytest.mark.parametrize("name", ["runs/1.csv", "recording.toml", "runs"])
def test_links_are_not_followed_and_nothing_of_their_target_is_said(refusal, sensing, tmp_path, name):
    sensing.write()
    secret = tmp_path / "elsewhere"
    (sensing.path / name).rename(secret)
    if secret.is_file():
        secret.write_text("secret\n")
    (sensing.path / name).symlink_to(secret)
    assert refusal(sensing.path) == f"night/{name}: a link; put the file itself there"


def test_a_pipe_is_refused_and_never_waited_for(refusal, sensing):
    sensing.write()
    (sensing.path / "runs/2.csv").unlink()
    os.mkfifo(sensing.path / "runs/2.csv")
    assert refusal(sensing.path) == "night/runs/2.csv: a device or a pipe; put a file there"


def test_the_bundle_itself_may_be_named_by_a_link(sensing, tmp_path):
    (tmp_path / "last").symlink_to(sensing.write())
    assert len(read_bundle(tmp_path / "last").runs()) == 3


def test_two_names_that_look_alike_are_refused(refusal, sensing):
    sensing.raw["Recording.toml"] = b""
    assert "are one name to other systems; rename or remove one" in refusal(sensing.write())


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFIFO])
def test_a_member_of_a_zip_that_is_no_file_is_refused(refusal, tmp_path, kind):
    with zipfile.ZipFile(tmp_path / "night.zip", "w") as archive:
        member = zipfile.ZipInfo("runs/1.csv")
        member.external_attr = (kind | 0o644) << 16
        archive.writestr(member, "/etc/passwd")
    assert re.fullmatch(
        r"night.zip: member 'runs/1.csv' is a (link|device or a pipe); pack the directory again",
        refusal(tmp_path / "night.zip"),
    )


def test_an_error_is_one_line_whatever_it_quotes(refusal, sensing):
    sensing.toml = sensing.toml.replace("g_m_s2", f'"a\\nb\\u001b{"x" * 5000}"').replace("9.803", '"none"')
    message = refusal(sensing.write())
    assert message.isprintable()
    assert len(message) < 800
