"""The compiled time step: Newton's method with contact regimes on the incremental potential (README.md).

advance    many steps at once, of adaptive or equal length: commands, steps, records
actuate    actions of the actuators in a step
between    rows of instants between the ends of steps
step       one step: implicit Euler or BDF2, and the memory for the next step
newton     Newton's method with the loads of the iterate; falls back to
descent    minimisation for given loads
regimes    open, sliding, sticking: the regime of each contact, changes of regime, breakaway
fronts     prediction of regimes, friction and loads, the initial guess of a step
loads      external loads on joints: forces, regimes, energy
evaluate   potential, residual and Jacobian at a trial state
faces      the point on the rim of an end face that touches the world
clamped    the step on the paper's ground, (P9) and (P10)
pose       states put into the arrays; settling, step by step
guard      shapes outside the model
ledger     the energy terms of a finished step
records    recorded rows of a run
arrays     every array, kernel and number, declared once, in a
block      of memory that compiled code shares with Python; kernels and parts of the solver are called by an
entry      in a table of addresses

segment_way is not part of the step: one segment along a given motion, without the rest of the worm.
"""
