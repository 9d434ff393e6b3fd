"""The simulator's kernels: formulas of `worm3d.physics`, combined and differentiated. The solver compiles them.

Each module defines CasADi functions for one kind of object, such as a segment. All functions of a module have the same
inputs and share an array of inputs, in which each input has its rows (`layout`).

    segment   eight contact points, springs, dampers and apex hinges of a segment
    point     loads on a contact point: inertia, weight, normal contact, friction
    joint     pitch, yaw and twist between two segments
    node      joints between segments as mass points
    actuator  actuators of chambers and hinges
    hysteresis, medium, load  friction in the joints of chambers, viscous media, external loads
    inertia, losses  terms that points and joints share
    change    derivatives of all of these with respect to a parameter
    regime    first-order prediction of a contact, with which the solver guesses its regime
"""

from math import nextafter

GREATEST_CONTRACTION = nextafter(1.0, 0.0)
"""Largest contraction of a state: the largest number below 1. With this value, rest lengths stay above 0."""
