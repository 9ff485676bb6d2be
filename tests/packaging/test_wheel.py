"""What an installed flexmbd holds: the source distribution and the wheel made of it."""

import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
FOLDERS = {"flexmbd": "flexmbd", "forms": "flexmbd/forms", "meshes": "flexmbd/meshes"}  # in the checkout: in the wheel
LEFT_OUT = shutil.ignore_patterns("__pycache__", "*.egg-info", ".*_cache", "out_*")


def packaged_files() -> set[str]:
    """All that the wheel shall hold, by its name there: every module, C source, py.typed and the sample meshes."""
    expected = set()
    for here, there in FOLDERS.items():
        folder = REPOSITORY / here
        linked = [link for link in folder.iterdir() if link.is_symlink()]
        for file in folder.rglob("*"):
            if any(link in file.parents or link == file for link in linked) or not file.is_file():
                continue
            sample = file.parent == REPOSITORY / "meshes" / "data"
            if file.suffix in (".py", ".c", ".h") or file.name == "py.typed" or sample:
                expected.add(f"{there}/{file.relative_to(folder).as_posix()}")
    return expected


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the two distributions, built without the network from a copy of the checkout."""
    copy, out = tmp_path_factory.mktemp("checkout"), tmp_path_factory.mktemp("dist")
    for file in REPOSITORY.iterdir():
        if file.name in FOLDERS or file.name in ("tests", "demos"):
            shutil.copytree(file, copy / file.name, symlinks=True, ignore=LEFT_OUT)
        elif file.is_file():
            shutil.copy2(file, copy / file.name)
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(copy)]
    done = subprocess.run(build, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def test_the_conda_recipe_asks_for_what_the_wheel_asks_for() -> None:
    """The same bounds; the rest is conda-forge's."""
    project = (REPOSITORY / "pyproject.toml").read_text()
    recipe = (REPOSITORY / "conda" / "recipe.yaml").read_text()
    (listed,) = re.findall(r"^dependencies = \[(.*?)^\]", project, re.DOTALL | re.MULTILINE)
    asked = [bound.partition(";")[0] for bound in re.findall(r'"([^"]+)"', listed)]
    assert len(asked) == 5
    for bound in asked:
        name, _, versions = bound.partition(">=")
        assert f"- {name} >={versions}\n" in recipe


def test_wheel_holds_every_module_and_nothing_else(distributions: Path) -> None:
    (wheel,) = distributions.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = [name for name in archive.namelist() if not name.endswith("/")]
    assert len(names) == len(set(names))
    content = {name for name in names if ".dist-info/" not in name}
    assert content == packaged_files()
    assert "flexmbd/py.typed" in content


def test_wheel_holds_the_licences(distributions: Path) -> None:
    (wheel,) = distributions.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        licences = {Path(name).name for name in archive.namelist() if ".dist-info/licenses/" in name}
        (metadata,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        text = archive.read(metadata).decode()
    assert licences == {"LICENSE", "COPYING"}
    assert "License-Expression: LGPL-3.0-or-later" in text


def test_source_distribution_has_real_folders(distributions: Path) -> None:
    (source,) = distributions.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        members = archive.getmembers()
    files = {member.name.partition("/")[2] for member in members if member.isfile()}
    assert {"flexmbd/forms/__init__.py", "flexmbd/meshes/__init__.py", "flexmbd/__init__.py"} <= files
    assert not [member.name for member in members if member.issym() or member.islnk()]


def test_installed_wheel_is_imported_without_the_checkout(distributions: Path, tmp_path: Path) -> None:
    (wheel,) = distributions.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    script = "import flexmbd, flexmbd.forms; print(flexmbd.__file__, flexmbd.forms.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, 'site'); {script}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["site/flexmbd/__init__.py", "site/flexmbd/forms/__init__.py"] or all(
        str(tmp_path) in file for file in done.stdout.split()
    )


def test_the_version_is_said_alike_everywhere():
    said = {}
    for name, pattern in {
        "flexmbd/__init__.py": r'^__version__ = "(.*)"$',
        "CITATION.cff": r"^version: (.*)$",
        "conda/recipe.yaml": r'^  version: "(.*)"$',
        ".zenodo.json": r'"version": "(.*)"',
        "docs/install.md": r"flexmbd-([0-9.]+)-py3-none-any.whl",
    }.items():
        said[name] = set(re.findall(pattern, (REPOSITORY / name).read_text(), re.MULTILINE))
    newest = re.search(r"^## (\S+)", (REPOSITORY / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest is not None
    assert all(versions == {newest[1]} for versions in said.values()), said
