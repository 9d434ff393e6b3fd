"""`worm3d study paper`: reproduces the tables and figures of the paper and tests its claims.

The paper is "Characterization and Simulation of a Worm-Inspired Robot". `planar.published` is the program behind its
results. `planar.linkage` is the same worm with corrected physics, called the corrected worm. Tags such as (P9) refer to
the equations in `planar.published`, Roman numbers such as IV.A to sections of the paper.
"""
