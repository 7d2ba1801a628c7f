"""A small part of benchmarks/fuzz_files.py: damaged files of every kind are read or refused in one sentence."""

import fuzz_files
import pytest


@pytest.mark.parametrize("reader", fuzz_files.READERS, ids=lambda reader: reader.name)
def test_damaged_files_are_read_or_refused(reader):
    outcomes = fuzz_files.fuzz_block(reader, 0, 60)["outcomes"]
    assert outcomes.keys() <= {"read", "refused"}
    assert outcomes["refused"] > 0
