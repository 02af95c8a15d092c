"""Build hook of hatchling: compiles the kernels of elastid/base/kernels into the wheel, or into an editable clone.

The compiler is $CC, else cc, gcc or clang, on Windows clang (gcc there aligns no registers of AVX, and MSVC has no
vector types). Without one, or where it fails, the wheel is one of pure Python for every platform, and a warning says
so; `CC=none` asks for that. A wheel with the library serves every Python of its platform.
"""

import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDER = Path("elastid", "base", "kernels")
# Sums keep their order, NaN and infinity what they are; roots need no errno, which would have them taken one by one.
FLAGS = ("-O3", "-ffp-contract=fast", "-fno-math-errno", "-fvisibility=hidden")
AVX2 = ("-mavx2", "-mfma")
LEVELS = {
    "portable": (),
    "avx2": AVX2,
    "avx512": (*AVX2, "-mavx512f", "-mavx512cd", "-mavx512dq", "-mavx512bw", "-mavx512vl"),
}
OLDEST_MACOS = "11.0"
MAX_COMPILE_S = 300.0  # of one file, on a busy machine


class KernelsHook(BuildHookInterface):  # type: ignore[misc]
    """Adds the library to the wheel, which is then one of this platform."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the library; version: standard or editable."""
        target = sysconfig.get_platform()  # of cross-compilation, too: _PYTHON_HOST_PLATFORM
        library = Path(self.root) / FOLDER / ("kernels.dll" if target.startswith("win") else "kernels.so")
        try:
            build(compiler(target), target, library)
        except (OSError, RuntimeError, subprocess.TimeoutExpired) as error:
            self.app.display_warning(f"elastid is built without its kernels in C, NumPy does their work: {error}")
            return
        build_data["artifacts"].append(library.relative_to(self.root).as_posix())
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{wheel_platform(target)}"


def compiler(target: str) -> list[str]:
    """Return the command of the C compiler; OSError without one."""
    try:
        cc = shlex.split(os.environ.get("CC", ""), posix=os.name != "nt")
    except ValueError as error:
        raise OSError(f"CC={os.environ['CC']} is no command: {error}") from None
    names = [cc] if cc else [[name] for name in (("clang",) if target.startswith("win") else ("cc", "gcc", "clang"))]
    for name, *options in names:
        path = shutil.which(name)
        if path:
            return [path, *options]
    raise OSError(f"no C compiler: looked for {', '.join(name for name, *_ in names)}")


def build(command: list[str], target: str, library: Path) -> None:
    """Build the library, complete or not at all; OSError, RuntimeError or TimeoutExpired where that fails."""
    command = [*command, *platform_flags(target)]
    digest, headers = hashlib.sha256(), sorted(library.parent.glob("*.[ch]"))
    for path in headers:
        digest.update(path.read_bytes())
    with tempfile.TemporaryDirectory() as name:
        folder, calls = Path(name), []
        for path in (path for path in headers if path.suffix == ".c"):
            for magnitude in magnitudes(target) if path.stem != "processor" else ("portable",):
                words = [*FLAGS, *LEVELS[magnitude], f"-DLEVEL={magnitude}", f'-DSOURCES="{digest.hexdigest()}"']
                calls.append([*command, *words, "-c", str(path), "-o", str(folder / f"{path.stem}_{magnitude}.o")])
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(run, calls))
        made = folder / library.name
        run([*command, "-shared", *map(str, sorted(folder.glob("*.o"))), "-o", str(made), *math_library(target)])
        beside = library.with_suffix(f".{os.getpid()}")
        shutil.copyfile(made, beside)
        beside.replace(library)


def run(call: list[str]) -> None:
    """Run the compiler within MAX_COMPILE_S; RuntimeError with its last words where it fails."""
    process = subprocess.run(call, capture_output=True, timeout=MAX_COMPILE_S, stdin=subprocess.DEVNULL, check=False)
    if process.returncode:
        output = process.stderr.decode(errors="replace").strip()[-500:]
        raise RuntimeError(f"{call[0]} ends with status {process.returncode}: {output}")


def magnitudes(target: str) -> tuple[str, ...]:
    """Return levels of processor that kernels are compiled for; `processor.c` never chooses avx512 on macOS."""
    if machine(target) != "x86_64":
        return ("portable",)
    return ("portable", "avx2") if target.startswith("macosx") else tuple(LEVELS)


def machine(target: str) -> str:
    """Return processor family of a platform: x86_64, arm64, ..."""
    name = target.replace("_", "-").rsplit("-", 1)[-1] if target.startswith("win") else target.rsplit("-", 1)[-1]
    return {"amd64": "x86_64", "universal2": platform.machine()}.get(name, name)


def platform_flags(target: str) -> list[str]:
    """Return the flags of compiler and linker on one system."""
    if target.startswith("macosx"):
        return ["-fPIC", "-arch", machine(target), f"-mmacosx-version-min={OLDEST_MACOS}"]
    return [] if target.startswith("win") else ["-fPIC"]


def math_library(target: str) -> list[str]:
    """Return the library of the square root."""
    return ["-lm"] if target.startswith("linux") else []


def wheel_platform(target: str) -> str:
    """Return the platform in the name of the wheel."""
    if target.startswith("macosx"):
        return f"macosx_{OLDEST_MACOS.replace('.', '_')}_{machine(target)}"
    return target.replace("-", "_").replace(".", "_")
