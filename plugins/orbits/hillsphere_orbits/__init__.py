"""Built-in orbits plugin: families of periodic orbits, and what missions do with them.

The modules at the top serve any plant: `continuation` and `lockstep` (Newton's method and
pseudo-arclength continuation), `shooting` and `multiple_shooting` (the equations of a periodic
orbit), `stability`, `secondary` (bifurcations by kind), `parameter_continuation`, and `members`
(orbits at prescribed values). The families use them: `qso` (planar), `spatial_qso_families`,
`swing_qso_families` (several revolutions in the plane), `libration`, and `orbit_family` (any
plant). Further stages take the orbits: `invariant_manifolds`, `manifold_transfers`,
`swing_transfers`, `nonlinear_stability`, `station_keeping_index`, `station_keeping_flown`,
`coverage`, `fidelity_ladder` and `transfers_reflown` (higher-fidelity equations), `ephemeris`.
"""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "orbit_family",
            "qso",
            "hillsphere_orbits.qso.families:Qso",
            "hillsphere_orbits.qso.specs:QsoSpec",
            "quasi-satellite orbits from the far 2:1 ellipse to the body's surface",
        ),
        Component(
            "stage",
            "qso_family",
            "hillsphere_orbits.qso.qso_family:QsoFamilyStage",
            "hillsphere_orbits.qso.specs:QsoFamilySpec",
            "the family of quasi-satellite orbits and its members at prescribed values",
        ),
        Component(
            "stage",
            "bifurcations",
            "hillsphere_orbits.qso.bifurcations:BifurcationStage",
            "hillsphere_orbits.qso.specs:BifurcationSpec",
            "where other families branch off a family of planar orbits",
        ),
        Component(
            "stage",
            "spatial_qso_families",
            "hillsphere_orbits.spatial_qso_families.stage:SpatialFamiliesStage",
            "hillsphere_orbits.spatial_qso_families.specs:SpatialFamiliesSpec",
            "families in space from vertical bifurcations: members, multipliers, windows",
        ),
        Component(
            "stage",
            "station_keeping_index",
            "hillsphere_orbits.station_keeping_index.stage:StationKeepingStage",
            "hillsphere_orbits.spatial_qso_families.specs:StationKeepingSpec",
            "analytic cost of nulling the unstable component once per period",
        ),
        Component(
            "stage",
            "ephemeris",
            "hillsphere_orbits.ephemeris.stage:EphemerisStage",
            "hillsphere_orbits.ephemeris.specs:EphemerisSpec",
            "orbits and flights in inertial axes as CCSDS OEM and CSV",
        ),
        Component(
            "stage",
            "invariant_manifolds",
            "hillsphere_orbits.invariant_manifolds.stage:InvariantManifoldsStage",
            "hillsphere_orbits.invariant_manifolds.specs:InvariantManifoldsSpec",
            "invariant manifolds of unstable orbits and the crossings of their trajectories",
        ),
        Component(
            "stage",
            "nonlinear_stability",
            "hillsphere_orbits.nonlinear_stability.stage:NonlinearStabilityStage",
            "hillsphere_orbits.nonlinear_stability.specs:NonlinearStabilitySpec",
            "largest offsets that orbits survive, survival of injection errors, nearby resonances",
        ),
        Component(
            "orbit_family",
            "lyapunov",
            "hillsphere_orbits.libration.families:Lyapunov",
            "hillsphere_orbits.libration.specs:LyapunovSpec",
            "planar orbits about the libration point L1 or L2",
        ),
        Component(
            "orbit_family",
            "halo",
            "hillsphere_orbits.libration.families:Halo",
            "hillsphere_orbits.libration.specs:HaloSpec",
            "halo orbits about L1 or L2, from where they branch off the Lyapunov orbits",
        ),
        Component(
            "stage",
            "orbit_family",
            "hillsphere_orbits.orbit_family.stage:OrbitFamilyStage",
            "hillsphere_orbits.orbit_family.specs:OrbitFamilySpec",
            "any family followed; its members carried along parameters of the equations",
        ),
        Component(
            "stage",
            "coverage",
            "hillsphere_orbits.coverage.stage:CoverageStage",
            "hillsphere_orbits.coverage.specs:CoverageSpec",
            "ground track, altitude, eclipses and light on the ground of periodic orbits",
        ),
        Component(
            "stage",
            "swing_qso_families",
            "hillsphere_orbits.swing_qso_families.stage:SwingFamiliesStage",
            "hillsphere_orbits.swing_qso_families.specs:SwingFamiliesSpec",
            "planar families of several revolutions from in-plane bifurcations (MP-QSO)",
        ),
        Component(
            "stage",
            "swing_transfers",
            "hillsphere_orbits.swing_transfers.stage:SwingTransfersStage",
            "hillsphere_orbits.transfers.specs:SwingTransfersSpec",
            "transfers in the plane through orbits of several revolutions",
        ),
        Component(
            "stage",
            "fidelity_ladder",
            "hillsphere_orbits.fidelity_ladder.stage:FidelityLadderStage",
            "hillsphere_orbits.fidelity_ladder.specs:FidelityLadderSpec",
            "periodic orbits continued to higher-fidelity equations by multiple shooting",
        ),
        Component(
            "stage",
            "manifold_transfers",
            "hillsphere_orbits.manifold_transfers.stage:ManifoldTransfersStage",
            "hillsphere_orbits.manifold_transfers.specs:ManifoldTransfersSpec",
            "transfers between planar orbits along the manifolds of unstable ones",
        ),
        Component(
            "stage",
            "station_keeping_flown",
            "hillsphere_orbits.station_keeping_flown.stage:StationKeepingFlownStage",
            "hillsphere_orbits.station_keeping_flown.specs:StationKeepingFlownSpec",
            "orbits held in the closed loop: strategies, correction intervals, survival, cost",
        ),
        Component(
            "stage",
            "transfers_reflown",
            "hillsphere_orbits.transfers_reflown.stage:TransfersReflownStage",
            "hillsphere_orbits.transfers_reflown.specs:TransfersReflownSpec",
            "transfers and their impulses recomputed on higher-fidelity equations",
        ),
        Component(
            "format",
            "oem",
            "hillsphere_orbits.ephemeris.state_formats:OemFile",
            "hillsphere.formats.specs:OrbitMessageSpec",
            "a CCSDS Orbit Ephemeris Message (.oem)",
        ),
        Component(
            "format",
            "oem_xml",
            "hillsphere_orbits.ephemeris.state_formats:OemXml",
            "hillsphere.formats.specs:OrbitMessageSpec",
            "a CCSDS Orbit Ephemeris Message in XML (.xml)",
        ),
        Component(
            "format",
            "opm",
            "hillsphere_orbits.ephemeris.state_formats:OpmFile",
            "hillsphere.formats.specs:OrbitMessageSpec",
            "a CCSDS Orbit Parameter Message (.opm)",
        ),
        Component(
            "format",
            "opm_xml",
            "hillsphere_orbits.ephemeris.state_formats:OpmXml",
            "hillsphere.formats.specs:OrbitMessageSpec",
            "a CCSDS Orbit Parameter Message in XML (.xml)",
        ),
        Component(
            "format",
            "ocm",
            "hillsphere_orbits.ephemeris.state_formats:OcmFile",
            "hillsphere.formats.specs:OrbitMessageSpec",
            "a CCSDS Orbit Comprehensive Message (.ocm), which is only read",
        ),
        Component(
            "format",
            "states_csv",
            "hillsphere_orbits.ephemeris.state_formats:StatesCsv",
            "hillsphere.formats.specs:FileFormatSpec",
            "a table of states (.csv), which is only written",
        ),
    ]
