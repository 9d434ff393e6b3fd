"""The simulator's kernels: formulas of `worm3d.physics`, combined and differentiated; the solver compiles them.

Each module defines CasADi functions of one kind of instance. All functions of a module have the same list of inputs and
share one array; `layout` defines the rows of the inputs.

    segment   eight contact points, springs, dampers and apex hinges of a segment
    point     loads on a contact point: inertia, weight, normal contact, friction
    joint     pitch, yaw and twist between two segments
    node      joints as mass points
    actuator  actuators of chambers and hinges
    hysteresis, medium, load  friction in the joints of chambers, viscous media, external loads
    inertia, losses  terms that points and joints share
    regime    first-order prediction of a contact, for the solver's guess of the regime
"""

from math import nextafter

GREATEST_CONTRACTION = nextafter(1.0, 0.0)
"""Greatest contraction of a state: the greatest number below 1, so that rest lengths stay above 0."""
