"""Simulated records of a plant: what is drawn, in a file each; `simulate` puts it together."""

from obsdesign.data.simulation.trajectory import Simulation, simulate

__all__ = ["Simulation", "simulate"]
