"""The simulator's kernels: the formulas of `worm3d.physics` put together and derived; the solver compiles them.

Each module defines CasADi functions of one kind of instance, all with the same list of inputs, so that they share one
array; `layout` says in which rows the inputs stand.

    segment   eight contact points, springs, dampers and apex hinges of a segment
    point     what acts on a contact point: inertia, weight, normal contact, friction
    joint     pitch, yaw and twist between two segments
    node      joints as mass points
    actuator  what drives chambers and hinges
    hysteresis, medium, load  friction in the joints of chambers, viscous media, external loads
    inertia, losses  terms that points and joints share
    regime    what a contact does to first order, by which the solver guesses its regime
"""

GREATEST_CONTRACTION = 1.0 - 2.0**-53
"""Greatest contraction of a state: the greatest number below 1, so that rest lengths stay above 0."""
