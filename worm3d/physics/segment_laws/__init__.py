"""Segment laws: the energy, the outline and the domain of a segment as functions of length, bend and command."""
