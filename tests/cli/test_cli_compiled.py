import os

import pytest

from vsx_ros.cli.compiled import compile_kernels, compiler, is_compiled

BY = compiler()


def kernels_of(tmp_path, stamp_s, by=BY):
    """A folder with a kernel of the second 100, compiled in the second given, or never."""
    kernel = tmp_path / "loop.py"
    kernel.write_text("")
    os.utime(kernel, (100, 100))
    if stamp_s is not None:
        stamp = tmp_path / "__pycache__" / "warm.stamp"
        stamp.parent.mkdir()
        stamp.write_text(by)
        os.utime(stamp, (stamp_s, stamp_s))
    return tmp_path


def test_kernels_are_compiled_when_none_has_changed_since(tmp_path, capsys):
    folder = kernels_of(tmp_path, 200)
    assert is_compiled(folder)
    compile_kernels(folder)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("stamp_s", "by"), [(50, BY), (200, "numba 0.1, Python 3.8.0")])
def test_after_an_update_it_says_so_and_compiles_once(tmp_path, capfd, stamp_s, by):
    folder = kernels_of(tmp_path, stamp_s, by)
    assert not is_compiled(folder)
    compile_kernels(folder)
    assert "compiling the kernels" in capfd.readouterr().err
    assert is_compiled(folder)


def test_callers_of_what_has_changed_are_compiled_anew(tmp_path):
    folder = kernels_of(tmp_path, 50)
    caller = folder / "__pycache__" / "caller.nbc"
    caller.write_bytes(b"machine code of before")
    compile_kernels(folder)
    assert not caller.exists()


def test_a_package_that_no_setup_prepared_is_compiled_too(tmp_path):
    folder = kernels_of(tmp_path, None)
    assert not is_compiled(folder)
    compile_kernels(folder)
    assert is_compiled(folder)
