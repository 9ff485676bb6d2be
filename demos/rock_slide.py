# # A rock slide: a thousand pseudo-rigid stones that touch
#
# Stones of all forms lie on a slope that is too steep for their friction. They slide and roll down it, into each other,
# and come to rest in a box at its foot. Each is a pseudo-rigid body, which stretches and shears as a whole: the
# example of Zienkiewicz, Taylor and Fox (2014, The Finite Element Method for Solid and Structural Mechanics, section
# 8.2), who name the contacts as what is hard about it.
#
# `./run python demos/rock_slide.py`, a quarter of an hour; `--short` takes forty stones. A film goes to
# `out_rock_slide`.

import argparse
import time
from pathlib import Path

import numpy as np
import pyvista
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact

arguments = argparse.ArgumentParser()
arguments.add_argument("--short", action="store_true", help="forty stones")
short = arguments.parse_args().short
out = Path("out_rock_slide")
out.mkdir(exist_ok=True)

# ## The stones
#
# Twelve points on an ellipsoid each, whose hull is the stone: of it come mass and second moments, and it touches.

COUNT = 40 if short else 1000
DENSITY, SOFT = 2500.0, fm.StVenantKirchhoff(E=4e6, nu=0.2)
rng = np.random.default_rng(8)
ground = fm.System().ground


def stone() -> tuple[fm.Solid, contact.Polytope]:
    """An irregular stone of half a metre or so."""
    points = rng.normal(size=(12, 3))
    points *= rng.uniform(0.2, 0.34, 3) / np.linalg.norm(points, axis=1)[:, None]
    form = contact.ConvexPolytope(ground.frame(), points).polytope
    triangles = [(face[0], face[k], face[k + 1]) for face in form.faces for k in range(1, len(face) - 1)]
    return fm.Solid.from_surface(form.vertices, np.array(triangles), density=DENSITY), form


solids, forms = zip(*[stone() for _ in range(COUNT)], strict=True)

# ## The slope, the box, and what they are like to touch
#
# Friction sticks where it may: a bristle between two surfaces holds what rests. An impact at 1 m/s leaves a fifth of
# of the speed, a slower one more.

ANGLE, WIDTH, FOOT = np.radians(38.0), 3.0 if short else 7.0, 4.0 if short else 9.0  # rad, m, m
ROW, SPACING = int(WIDTH / 0.75), 0.72  # stones across, m
law = contact.PowerLaw(k=2e5, restitution=0.3, speed=3.0)
rough = contact.Friction(mu=0.5, stiffness=1e5, damping=400.0, load=1e3)
walls = [
    contact.HalfSpace(ground.frame(), (np.sin(ANGLE), 0.0, np.cos(ANGLE))),
    contact.HalfSpace(ground.frame()),
    contact.HalfSpace(ground.frame((FOOT, 0.0, 0.0)), (-1.0, 0.0, 0.0)),
    contact.HalfSpace(ground.frame((0.0, -0.5 * WIDTH, 0.0)), (0.0, 1.0, 0.0)),
    contact.HalfSpace(ground.frame((0.0, 0.5 * WIDTH, 0.0)), (0.0, -1.0, 0.0)),
]

layers = 2 if short else 4
number = np.arange(COUNT)
up, across, layer = number // (ROW * layers), number % ROW, number // ROW % layers
slope = Rotation.from_euler("y", ANGLE).as_matrix()
places = np.stack([-4.0 - SPACING * up, SPACING * (across - 0.5 * (ROW - 1)), 0.4 + SPACING * layer], axis=1)
slide = fm.PseudoRigidSwarm(
    solids, SOFT, r=places @ slope.T, gravity=(0.0, 0.0, -9.81), law=law, friction=rough, shapes=forms, walls=walls,
    damping=5e-4,
)  # fmt: skip
slide.F = Rotation.random(COUNT, rng=rng).as_matrix()

# ## Down
#
# A stone that is hit hard between others bears shorter steps than a pair that meets gently. `step` refuses what it
# cannot bear, and the stones are then where they were, so that half of the step is tried.

END, FRAMES = (5.5, 50) if short else (7.0, 100)
h = 0.5 * slide.stable_step()
taken = 0


def advance(span: float) -> int:
    """Go on by a time (s), in steps of h or less; how many there were."""
    count = int(span / h) + 1
    for _ in range(4):
        try:
            slide.step(span / count, count)
            break
        except fm.SceneError as refused:
            reason = refused
            count *= 2
    else:
        raise reason
    return count


print(f"{COUNT} stones, {slide.mass.sum() / 1e3:.1f} t; steps of {h * 1e6:.0f} microseconds at most")
print("  t, s  contacts  kinetic, kJ  weight's, kJ  fastest, m/s  largest stretch")
states = [(slide.r, slide.F)]
spent = 0.0
for frame in range(FRAMES):
    began = time.process_time()
    taken += advance(END / FRAMES)
    spent += time.process_time() - began
    states.append((slide.r, slide.F))
    if (frame + 1) % (FRAMES // 10) == 0:
        energy, found = slide.energy(), slide.contacts()
        fastest = np.linalg.norm(slide.v, axis=1).max()
        stretch = abs(np.linalg.svd(slide.F, compute_uv=False) - 1.0).max()
        numbers = f"{energy.kinetic.sum() / 1e3:11.3f} {energy.gravitational.sum() / 1e3:13.1f} {fastest:13.4f}"
        print(f"{slide.t:6.2f} {len(found.depth):9d}  {numbers} {stretch:16.4f}", flush=True)

still = np.linalg.norm(slide.v, axis=1) < 0.02
pairs = np.unique(slide.contacts().bodies, axis=0)
print(f"{still.mean():.1%} of the stones move by less than 2 cm/s, {len(pairs)} pairs touch; their centres are between")
low, high = slide.r.min(axis=0), slide.r.max(axis=0)
print(f"x = {low[0]:.2f} and {high[0]:.2f} m, z = {low[2]:.2f} and {high[2]:.2f} m")
print(f"{spent:.1f} s of processor time, {taken} steps, {spent / (COUNT * taken) * 1e6:.2f} microseconds a stone each")

# ## The film
#
# All stones are one surface, whose points go along with r and F.

corners = [form.vertices - solid.com for form, solid in zip(forms, solids, strict=True)]
owner = np.repeat(number, [len(x) for x in corners])
first = np.cumsum([0, *(len(x) for x in corners)])
faces = [[len(face), *(first[k] + i for i in face)] for k, form in enumerate(forms) for face in form.faces]
reference = np.vstack(corners)


def placed(r: np.ndarray, F: np.ndarray) -> np.ndarray:
    """The points of all stones."""
    return r[owner] + np.einsum("nij,nj->ni", F[owner], reference)


surface = pyvista.PolyData(placed(*states[0]), np.concatenate(faces))
surface.cell_data["shade"] = np.repeat(rng.uniform(size=COUNT), [len(form.faces) for form in forms])
far = abs(places[:, 0]).max() + 1.0
plane = pyvista.Box((-far, 0.0, -0.5 * WIDTH, 0.5 * WIDTH, -0.2, 0.0)).rotate_y(np.degrees(ANGLE), point=(0, 0, 0))
floor = pyvista.Box((0.0, FOOT, -0.5 * WIDTH, 0.5 * WIDTH, -0.2, 0.0))
wall = pyvista.Box((FOOT, FOOT + 0.2, -0.5 * WIDTH, 0.5 * WIDTH, -0.2, 2.0))
plotter = pyvista.Plotter(off_screen=True, window_size=(640, 400))
for part in (plane, floor, wall):
    plotter.add_mesh(part, color="#b9b4aa")
plotter.add_mesh(surface, scalars="shade", cmap="copper", show_scalar_bar=False)
top = plane.points[:, 2].max()
middle = np.array([0.5 * (plane.points[:, 0].min() + FOOT), 0.0, 0.4 * top])
plotter.camera_position = [tuple(middle + 1.65 * far * np.array([0.35, -1.0, 0.35])), tuple(middle), (0.0, 0.0, 1.0)]
plotter.open_gif(str(out / "rock_slide.gif"), fps=15, palettesize=64)
for r, F in states:
    surface.points = placed(r, F)
    plotter.write_frame()
plotter.screenshot(str(out / "rock_slide.png"))
plotter.close()
