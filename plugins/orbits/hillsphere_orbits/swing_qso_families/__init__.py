"""Periodic orbits of several revolutions in the plane ("swing" or MP-QSO families).

At a planar resonance d:n orbits that close after n revolutions branch off the quasi-satellite
orbits: `branching` finds them from the kernel of the n-revolution map, `families` follows them, and
`curves` takes a computed family up again between its members.
"""
