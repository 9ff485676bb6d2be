"""Functional mock-up units driven through FMPy, which knows nothing of flexmbd."""

import ctypes

import fmpy
import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.fmi3 import FMU3Model, FMU3Slave


class Unit:
    """An unzipped unit of either version: makes instances, knows its variables by name."""

    def __init__(self, path, folder):
        self.folder = str(path) if path == folder else extract(str(path), str(folder))
        self.description = read_model_description(str(path))
        self.fmi = int(self.description.fmiVersion[0])
        self.references = {one.name: one.valueReference for one in self.description.modelVariables}

    def instance(self, name="one", *, exchange=False, **start):
        """An initialised instance, with values set before; in model exchange after its first events."""
        one = Instance(self, name, exchange=exchange)
        one.initialise(**start)
        return one


class Instance:
    """One instance of a unit."""

    def __init__(self, unit, name="one", token=None, *, exchange=False):
        kinds = (FMU2Model, FMU3Model) if exchange else (FMU2Slave, FMU3Slave)
        kind = kinds[unit.fmi - 2]
        self.unit, self.t = unit, 0.0
        self.fmu = kind(
            guid=token or unit.description.guid,
            unzipDirectory=unit.folder,
            modelIdentifier=unit.description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.fmu.instantiate()

    def initialise(self, t=0.0, **start):
        self.t = t
        if self.unit.fmi == 2:
            self.fmu.setupExperiment(startTime=t)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=t)
        self.set(start)
        self.fmu.exitInitializationMode()

    def set_states(self, states):
        """In model exchange, at the time it is."""
        self.fmu.enterContinuousTimeMode()
        self.fmu.setContinuousStates((ctypes.c_double * len(states))(*states), len(states))

    def direction(self, unknowns, knowns, change):
        """The directional derivative of variables by others, by their names."""
        references = [[self.unit.references[name] for name in names] for names in (unknowns, knowns)]
        return np.array(self.fmu.getDirectionalDerivative(*references, list(change)))

    def set(self, values):
        if values:
            references = [self.unit.references[name] for name in values]
            (self.fmu.setReal if self.unit.fmi == 2 else self.fmu.setFloat64)(references, list(values.values()))

    def get(self, names):
        references = [self.unit.references[name] for name in names]
        return np.array((self.fmu.getReal if self.unit.fmi == 2 else self.fmu.getFloat64)(references))

    def step(self, h):
        self.fmu.doStep(self.t, h)
        self.t += h

    def keep(self):
        return self.fmu.getFMUstate() if self.unit.fmi == 2 else self.fmu.getFMUState()

    def restore(self, state):
        self.fmu.setFMUstate(state) if self.unit.fmi == 2 else self.fmu.setFMUState(state)

    def free(self):
        self.fmu.freeInstance()


def library(unit):
    """The unit's binary as ctypes sees it, for calls that FMPy would not make."""
    identifier = unit.description.coSimulation.modelIdentifier
    platform = "linux64" if unit.fmi == 2 else fmpy.platform_tuple
    return ctypes.CDLL(f"{unit.folder}/binaries/{platform}/{identifier}.so")
