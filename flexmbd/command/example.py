"""`flexmbd example slider_crank`: a folder with a scene that runs, to begin with."""

from __future__ import annotations

import argparse
import difflib
from pathlib import Path

from flexmbd.command.body_file import check_free, make_folder
from flexmbd.command.examples import EXAMPLES
from flexmbd.command.terminal import add_json, print_json, print_line
from flexmbd.errors import SceneError
from flexmbd.files.whole_file import write_file


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    width = max(map(len, EXAMPLES))
    parser.description = "Write a scene that runs, with all it needs, into a folder of its name."
    parser.epilog = "\n".join(
        [
            "names:",
            *(f"  {one.name:<{width}}  {one.about}" for one in EXAMPLES.values()),
            "",
            "examples:",
            "  flexmbd example                                  lists them",
            "  flexmbd example slider_crank",
            "  flexmbd example slider_crank -o my_machine",
        ]
    )
    parser.add_argument("name", nargs="?", help="which; without it they are listed")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="the folder (default: NAME)")
    parser.add_argument("--force", action="store_true", help="replace files that are there")
    add_json(parser)
    parser.set_defaults(run=example)


def example(arguments: argparse.Namespace) -> int:
    """Write the files. Not collective.

    Raises:
        SceneError: there is no such example, or the folder cannot be made.
        ExportError: files are there already, or cannot be written.
    """
    name: str | None = arguments.name
    if name is None:
        if arguments.json:
            print_json({"examples": {one.name: one.about for one in EXAMPLES.values()}})
        else:
            print_line("\n".join(f"{one.name}: {one.about}" for one in EXAMPLES.values()))
        return 0
    if name not in EXAMPLES:
        near = difflib.get_close_matches(name, EXAMPLES, n=1)
        raise SceneError(
            f"there is no example {name!r}; "
            + (f"did you mean {near[0]!r}?" if near else f"there are {', '.join(EXAMPLES)}")
        )
    chosen = EXAMPLES[name]
    folder: Path = arguments.output or Path(name)
    make_folder(folder)
    files = [folder / file for file in chosen.files]
    for path in files:
        check_free(path, force=arguments.force)
    for path in files:
        write_file(path, chosen.files[path.name])
    if arguments.json:
        print_json({"files": files, "then": chosen.then})
        return 0
    print_line("\n".join(map(str, files)))
    print_line(f"\ntry:\n  cd {folder}\n  flexmbd simulate scene.toml")
    for line in chosen.then:
        print_line(f"  {line}")
    return 0
