"""The compiled time step: Newton's method with contact regimes on the incremental potential (README.md).

advance    many steps at once, as long as an allowed error lets them be or all alike: commands, steps, records
actuate    what actuators do in a step
between    rows of instants between the ends of steps
step       one step: implicit Euler or BDF2, and what the next one remembers
newton     Newton's method with the loads of the iterate; falls back to
descent    minimisation for given loads
regimes    open, sliding, sticking: how each contact is treated, changes of that, breakaway
fronts     prediction of regimes, friction and loads, from which a step begins
loads      what acts on joints from outside: forces, regimes, energy
evaluate   potential, residual and Jacobian at a trial state
faces      which place of the rim of an end face touches the world
clamped    the step on the paper's ground, (P9) and (P10)
pose       states put into the arrays; settling, step by step
guard      shapes that the model does not stand for
ledger     the energy terms of a finished step
records    what is kept of a run
arrays     every array, kernel and number, declared once, in a
block      of memory that compiled code shares with Python; kernels and parts of the solver are called by an
entry      in a table of addresses

segment_way is no part of the step: one segment along a given way, without the rest of the worm.
"""
