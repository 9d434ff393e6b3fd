"""The compiled time step: Newton's method with contact regimes on the incremental potential (README.md).

advance    many steps in one call, of adaptive or equal length: commands, steps, records
actuate    response of the actuators in a step
between    recorded rows at instants between the ends of steps
step       one step with implicit Euler or BDF2, and the memory for the next step
newton     Newton's method with the loads of each iterate
descent    fallback of Newton's method: minimisation for given loads
regimes    regime of each contact (open, sliding, sticking), changes of regime, breakaway
fronts     prediction of regimes, friction and loads, which is the initial guess of a step
loads      external loads on joints: forces, regimes, energy
evaluate   potential, residual and Jacobian at a trial state
faces      the point on the rim of an end face that touches the world
sensitivity  steps with derivatives with respect to parameters of the commands
clamped    the step on the ground of the paper, (P9) and (P10)
pose       copying of states into the arrays; settling before a run
guard      detection of shapes outside the model
ledger     energy terms of a finished step
records    recorded rows of a run
arrays     declarations of all arrays, kernels and numbers
block      a block of memory for these arrays, which compiled code shares with Python
entry      calls of kernels and of parts of the solver through a table of addresses

segment_way is not part of the step. It computes one segment along a given motion, without the rest of the worm.
"""
