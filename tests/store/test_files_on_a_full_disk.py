"""A full disk ends in one error with the name of the file, nothing half, and a process that goes on."""

import subprocess
import sys
from pathlib import Path

import pytest

# In a process of its own: HDF5 that crashes does so when the process ends.
PROGRAM = """
import resource, sys
from pathlib import Path
import numpy as np
from elastid.store.artefacts import NO_STAMP, created
from elastid.store.files import text_file

def write(path):
    with created(path, "test", NO_STAMP) as file:
        for name in "abc":
            group = file.create_group(name)
            group.create_dataset("t", data=np.arange(200.0))
            group.create_dataset("v", data=np.arange(200.0))

def write_text(path):
    with text_file(path) as file:
        file.write("x" * 20_000)

folder = Path(sys.argv[1])
for name, work in (("a.h5", write), ("a.csv", write_text)):
    work(folder / name)
    whole = (folder / name).read_bytes()
    (folder / name).unlink()
    refused = 0
    for limit in [*range(0, len(whole), 3000), len(whole)]:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        try:
            work(folder / name)
        except OSError as error:
            assert error.filename == str(folder / name), error
            assert not list(folder.iterdir()), list(folder.iterdir())
            refused += 1
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
    assert (folder / name).read_bytes() == whole
    (folder / name).unlink()
    print(refused)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="the limit of a file's size is one of POSIX")
def test_a_file_that_does_not_fit_is_named_and_absent(tmp_path: Path) -> None:
    """At every size of the disk; at the size of the file it is written, the same bytes."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(int(count) >= 6 for count in done.stdout.split())
