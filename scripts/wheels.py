"""Build the source distribution and, from it, the wheel of this platform; install and try both kinds of wheel.

    python scripts/wheels.py [--out FOLDER]

The wheel with the kernels in C, and the wheel of pure Python that is built without a compiler (CC=none), are each
installed into an empty environment, where the kernels in use are asked for and a new study is checked. Only the first
is kept. Wheels for other platforms: `uvx cibuildwheel` on each of the three systems, with the table tool.cibuildwheel
of pyproject.toml. The last line is one JSON object.
"""

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ASKED = "from elastid.base import kernels; print(kernels.description())"


def main() -> None:
    """Build both wheels and test them; print the JSON line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of source distribution and wheel")
    out = parser.parse_args().out.resolve()
    with tempfile.TemporaryDirectory() as name:
        pure = Path(name, "pure")
        uv("build", "--sdist", "--out-dir", str(out), str(ROOT))
        (sdist,) = out.glob("elastid-*.tar.gz")
        wheels = []
        for folder, environment in ((out, {}), (pure, {"CC": "none"})):
            before = set(folder.glob("*.whl"))
            uv("build", "--wheel", "--out-dir", str(folder), str(sdist), **environment)
            made = set(folder.glob("*.whl"))
            wheels.append(max(made - before or made, key=lambda path: path.stat().st_mtime))
        used = [test_wheel(wheel, Path(name, wheel.stem)) for wheel in wheels]
    assert used[1] == "kernels in NumPy", used
    assert wheels[1].name.endswith("py3-none-any.whl"), wheels[1]
    assert used[0].startswith("kernels in C"), f"{wheels[0].name} was built without a C compiler: {used[0]}"
    assert "-py3-none-" in wheels[0].name, wheels[0]
    assert "any" not in wheels[0].name, wheels[0]
    print(json.dumps({wheel.name: kernels for wheel, kernels in zip(wheels, used, strict=True)}))


def test_wheel(wheel: Path, environment: Path) -> str:
    """Test the kernels of a wheel in an empty environment, where a new study of it passes its check."""
    python = environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    uv("venv", str(environment))
    uv("pip", "install", "--python", str(python), str(wheel))
    study = environment / "study"
    for words in (["new", str(study)], ["check", str(study / "study.yml")]):
        subprocess.run([python, "-m", "elastid", *words], check=True, cwd=environment, stdout=subprocess.DEVNULL)
    done = subprocess.run([python, "-c", ASKED], check=True, cwd=environment, stdout=subprocess.PIPE)
    return done.stdout.decode().strip()


def uv(*words: str, **environment: str) -> None:
    """Run uv; CalledProcessError where it fails."""
    subprocess.run(["uv", *words, "--quiet"], check=True, env=os.environ | environment)


if __name__ == "__main__":
    main()
