"""The compiled time step: arrays, evaluation of the incremental potential, Newton's method, steps and chunks of steps.

arrays     everything that a step reads and writes, in the layout of the kernels
evaluate   potential, gradient and Hessian of a step at a trial state
fronts     what contacts are expected to do in a step: their trends, and fronts that run along the body
regimes    what contacts are taken for while Newton iterates, and when the law denies it
newton     descent at given normal loads, then Newton with the loads of the iterate itself
step       one step: implicit Euler or BDF2, contacts that break away, the histories
ledger     the energy terms of a finished step
advance    many steps at once, guards, recording
"""
