"""Rate-independent plasticity of one deformation d, from a curve of straight pieces: elastic, then hardening.

A share of the force hardens kinematically, the rest isotropically; each follows the curve where d grows from rest.

- Kinematic: elements of stiffness k_i that yield at the force k_i e_i side by side, and a spring (Iwan 1966, Besseling
  1958).  After a turn the curve is the first one at twice the scale, as Masing's rule has it.
- Isotropic: one element of the elastic stiffness whose yield force Y grows with the plastic way z that it has gone.

Both are solved exactly on a way without turns.  Their numbers: the share; n; the elastic stiffness; n times k_i, e_i;
the spring's stiffness; n times z_i, Y_i; the slope dY/dz beyond the last.  Their memory: the plastic deformation
d - F / stiffness, the way that it has gone, the dissipated energy (J); isotropic plastic deformation and
z; n kinematic ones.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import kernel

N_NUMBERS_BEFORE, N_MEMORY_BEFORE = 3, 5  # of the n elements
_PLASTIC, _WAY, _DISSIPATED, _ISOTROPIC, _ISOTROPIC_WAY = range(N_MEMORY_BEFORE)


@kernel
def _flow_elements(data, o, n, memory, way, d):
    """Force, slope, energy, plastic force k_i p_i, dissipated energy, and how many flow, of elements side by side."""
    spring = data[o + 2 * n]
    force = spring * d
    slope = spring
    energy = 0.5 * spring * d * d
    plastic = 0.0
    lost = 0.0
    flowing = 0.0
    for i in range(n):
        k = data[o + 2 * i]
        most = data[o + 2 * i + 1]
        stretch = d - memory[N_MEMORY_BEFORE + i]
        if way * stretch > 0.0 and abs(stretch) > most:
            held = math.copysign(most, stretch)
            memory[N_MEMORY_BEFORE + i] = d - held
            lost += k * most * abs(stretch - held)
            stretch = held
            flowing += 1.0
        else:
            slope += k
        force += k * stretch
        energy += 0.5 * k * stretch * stretch
        plastic += k * memory[N_MEMORY_BEFORE + i]
    return force, slope, energy, plastic, lost, flowing


@kernel
def _flow_isotropically(data, o, n, stiffness, memory, way, d):
    """Force, slope, energy, dissipated energy and the piece, 0 where it does not flow, of the element that grows."""
    stretch = d - memory[_ISOTROPIC]
    slope = stiffness
    lost = 0.0
    piece = 0.0
    if way * stretch > 0.0:
        size = abs(stretch)
        z = memory[_ISOTROPIC_WAY]
        flow = 0.0
        for i in range(n):
            hardening = data[o + 2 * n]
            room = math.inf
            if i + 1 < n:
                length = data[o + 2 * i + 2] - data[o + 2 * i]
                hardening = (data[o + 2 * i + 3] - data[o + 2 * i + 1]) / length
                room = data[o + 2 * i + 2] - z
            if not room > 0.0:
                continue
            limit = data[o + 2 * i + 1] + hardening * (z - data[o + 2 * i])
            more = min(room, (stiffness * (size - flow) - limit) / (stiffness + hardening))
            if not more > 0.0:
                break
            flow += more
            z += more
            lost += (limit + 0.5 * hardening * more) * more
            slope = stiffness * hardening / (stiffness + hardening)
            piece = 1.0 + i
        stretch = math.copysign(size - flow, stretch)
        memory[_ISOTROPIC] = d - stretch
        memory[_ISOTROPIC_WAY] = z
    return stiffness * stretch, slope, 0.5 * stiffness * stretch * stretch, lost, piece


@kernel
def elastoplastic(data, o, memory, begin, d):
    """Lead ``memory`` from one deformation to d without a turn; the force, its slope, the piece, the energy stored.

    Where the way has no length nothing flows, and the slope is the elastic one.  The numbers begin at ``data[o]``.
    """
    share = data[o]
    n = int(data[o + 1])
    stiffness = data[o + 2]
    way = d - begin
    force = 0.0
    slope = 0.0
    energy = 0.0
    piece = 0.0
    plastic = 0.0
    first = o + N_NUMBERS_BEFORE
    if share > 0.0:
        part, rise, stored, held, lost, flowing = _flow_elements(data, first, n, memory, way, d)
        force += share * part
        slope += share * rise
        energy += share * stored
        plastic += share * held / stiffness
        memory[_DISSIPATED] += share * lost
        piece += flowing
    if share < 1.0:
        second = first + 2 * n + 1
        part, rise, stored, lost, flowing = _flow_isotropically(data, second, n, stiffness, memory, way, d)
        force += (1.0 - share) * part
        slope += (1.0 - share) * rise
        energy += (1.0 - share) * stored
        plastic += (1.0 - share) * memory[_ISOTROPIC]
        memory[_DISSIPATED] += (1.0 - share) * lost
        piece += (n + 1) * flowing
    memory[_WAY] += abs(plastic - memory[_PLASTIC])
    memory[_PLASTIC] = plastic
    return force, slope, piece, energy
