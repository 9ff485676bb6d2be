"""Materials that decks give to their solids: offered in SI units, by the units that are said; never taken silently."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from flexmbd.continuum.parallel import on_root
from flexmbd.errors import ExportError, MeshError
from flexmbd.files.bulk_cards import read_bulk, real
from flexmbd.files.units import UnitSystem, unit_system
from flexmbd.meshes.abaqus_file import Block, blocks
from flexmbd.meshes.dimension import check_arguments, checked_part


@dataclass(frozen=True)
class DeckMaterial:
    """An isotropic elastic material of a deck.

    Attributes:
        name: what the deck calls it, as "MAT1 3".
        E: Young's modulus, Pa.
        nu: Poisson's ratio.
        rho: density, kg/m³; 0 where the deck gives none.
    """

    name: str
    E: float
    nu: float
    rho: float


@checked_part
def materials(path: str | Path, *, units: str, comm: MPI.Comm = MPI.COMM_WORLD) -> dict[str, DeckMaterial]:
    """The isotropic materials of a deck's solids, by the names of the cell groups that `read` makes. Collective.

    Of Nastran MAT1 by PSOLID, its density times PARAM,WTMASS; of Abaqus and CalculiX *ELASTIC and *DENSITY by
    *SOLID SECTION. What depends on temperature or direction is left out. `read` takes no material: give what is
    meant to the form, as `forms.solid_linear.Parameters(E=found.E, nu=found.nu, rho=found.rho)`.

    Args:
        path: of the deck, which is read on rank 0.
        units: what the deck is in, length-mass-time, as "mm-t-s" or "m-kg-s"; no deck says it.
        comm: the ranks.

    Raises:
        MeshError: on all ranks; the deck cannot be read, is of another kind, or has no such material; units are none.
    """
    system: list[UnitSystem] = []

    def check() -> None:
        try:
            system.append(unit_system(units))
        except ExportError as error:
            raise MeshError(str(error)) from error

    check_arguments(comm, {"path": path, "units": units}, check)
    return on_root(comm, lambda: _materials(Path(path), system[0]))


def _materials(path: Path, units: UnitSystem) -> dict[str, DeckMaterial]:
    suffix = path.suffix.lower()
    try:
        if suffix in (".bdf", ".nas", ".dat", ".blk", ".fem"):
            found = _of_bulk(path)
        elif suffix == ".inp":
            found = _of_input(path)
        else:
            raise MeshError(f"{path}: materials are read from .bdf, .nas, .dat, .blk and .inp")
    except ExportError as error:
        raise MeshError(str(error)) from error
    except ValueError as error:
        raise MeshError(f"{path}: {error}") from error
    if not found:
        raise MeshError(f"{path}: its solids have no isotropic elastic material (MAT1 by PSOLID, *ELASTIC by section)")
    stress, density = units.mass / (units.length * units.time**2), units.mass / units.length**3
    return {
        name: DeckMaterial(one.name, stress * one.E, one.nu, density * one.rho) for name, one in found.items()
    }


def _of_bulk(path: Path) -> dict[str, DeckMaterial]:
    cards = read_bulk(path, wanted=("MAT1", "PSOLID", "PARAM")).cards
    weight = next((card.real(1) for card in cards.get("PARAM", []) if card[0].upper() == "WTMASS"), 1.0)
    known = {}
    for card in cards.get("MAT1", []):
        young, shear = card.real(1), card.real(2)
        ratio = card.real(3) if card[3] or not (young and shear) else young / (2.0 * shear) - 1.0
        young = young or 2.0 * shear * (1.0 + ratio)
        known[card.whole(0)] = DeckMaterial(card.title, young, ratio, weight * card.real(4))
    owners = {f"property {card[0]}": card.whole(1) for card in cards.get("PSOLID", [])}
    return {name: known[owner] for name, owner in owners.items() if owner in known}


def _of_input(path: Path) -> dict[str, DeckMaterial]:
    young: dict[str, tuple[str, float, float]] = {}
    density: dict[str, float] = {}
    sections: dict[str, str] = {}
    name = ""
    for block in blocks(path, depth=0):
        options = block.options
        if block.keyword == "MATERIAL":
            name = options.get("NAME", "")
        elif block.keyword == "ELASTIC" and options.get("TYPE", "ISOTROPIC").upper().startswith("ISO"):
            constants = _numbers(block) if len(block.lines) == 1 else []
            if len(constants) >= 2:
                young[name.upper()] = (name, constants[0], constants[1])
        elif block.keyword == "DENSITY" and len(block.lines) == 1:
            density[name.upper()] = (_numbers(block) or [0.0])[0]
        elif block.keyword == "SOLID SECTION":
            sections[options.get("ELSET", "")] = options.get("MATERIAL", "").upper()
    return {
        group: DeckMaterial(*young[key], density.get(key, 0.0)) for group, key in sections.items() if key in young
    }


def _numbers(block: Block) -> list[float]:
    return [real(field.strip()) for field in block.lines[0].split(",") if field.strip()]
