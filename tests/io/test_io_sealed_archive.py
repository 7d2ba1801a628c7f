import io
import zipfile

import pytest

from vsx_ros.io.sealed_archive import glance, seal, unseal
from vsx_ros.limits import MIB

ENTRIES = {"a.json": b'{"x": 1}', "b/c.png": bytes(range(256)), "empty": b""}


def test_what_was_sealed_comes_back_in_order_and_the_same_bytes_each_time():
    assert list(unseal(seal(ENTRIES)).items()) == list(ENTRIES.items())
    assert seal(ENTRIES) == seal(dict(ENTRIES))


def test_what_packs_very_well_comes_back_too():
    zeros = {"a.npy": bytes(24 * MIB), "b.npy": bytes(24 * MIB), "c.npy": bytes(24 * MIB)}
    sealed = seal(zeros)
    assert len(sealed) < 30 * MIB
    assert unseal(sealed) == zeros


def test_any_zip_tool_opens_it():
    with zipfile.ZipFile(io.BytesIO(seal(ENTRIES))) as archive:
        assert archive.testzip() is None
        assert {name: archive.read(name) for name in archive.namelist()} == ENTRIES


def test_every_single_changed_byte_is_noticed():
    whole = seal(ENTRIES)
    for position in range(len(whole)):
        changed = bytearray(whole)
        changed[position] ^= 0x10
        with pytest.raises(ValueError, match=r"no sealed archive|checksum"):
            unseal(bytes(changed))


def test_every_cut_and_every_tail_is_noticed():
    whole = seal(ENTRIES)
    for length in range(len(whole)):
        with pytest.raises(ValueError, match=r"no sealed archive|checksum"):
            unseal(whole[:length])
    with pytest.raises(ValueError, match="checksum"):
        unseal(whole + b"\n")


def test_one_entry_is_read_alone(tmp_path):
    path, whole = tmp_path / "map.zip", seal(ENTRIES, quick=True)
    path.write_bytes(whole)
    assert glance(path, "a.json") == ENTRIES["a.json"]
    with pytest.raises(ValueError, match=r"d\.json cannot be unpacked"):
        glance(path, "d.json")
    for damaged in (b"", whole[:-100], whole.replace(ENTRIES["a.json"], b'{"x": 2}')):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"a\.json cannot be unpacked"):
            glance(path, "a.json")


def test_a_foreign_zip_is_not_sealed():
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("x", b"y" * 200)
    with pytest.raises(ValueError, match="checksum"):
        unseal(buffer.getvalue())
