"""Components of the core itself, registered like those of any plugin."""

from __future__ import annotations

from hillsphere.plugins.registry import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the core's components."""
    return [
        Component(
            "body",
            "moon",
            "hillsphere.model.bodies:Moon",
            "hillsphere.model.bodies:MoonSpec",
            "a small moon on a Keplerian orbit around its primary",
        ),
        Component(
            "body",
            "asteroid",
            "hillsphere.model.bodies:Moon",
            "hillsphere.model.bodies:AsteroidSpec",
            "an asteroid with a spin of its own on a Keplerian orbit around the Sun",
        ),
        Component(
            "body",
            "solar_orbit",
            "hillsphere.model.ephemeris:KeplerOrbit",
            "hillsphere.model.ephemeris_specs:KeplerOrbitSpec",
            "a planet or spacecraft on a Keplerian orbit around the Sun, for ephemerides",
        ),
        Component(
            "body",
            "spice",
            "hillsphere.model.spice:SpiceOrbit",
            "hillsphere.model.ephemeris_specs:SpiceOrbitSpec",
            "a body where a SPICE kernel says that it is (extra 'spice')",
        ),
        Component(
            "shape",
            "ellipsoid",
            "hillsphere.model.shapes.ellipsoid:EllipsoidShape",
            "hillsphere.model.shapes.specs:EllipsoidShapeSpec",
            "a tri-axial ellipsoid",
        ),
        Component(
            "shape",
            "harmonics",
            "hillsphere.model.shapes.harmonic:HarmonicShape",
            "hillsphere.model.shapes.specs:HarmonicShapeSpec",
            "the radius as a series of spherical harmonics",
        ),
        Component(
            "shape",
            "grid",
            "hillsphere.model.shapes.grid:GridShape",
            "hillsphere.model.shapes.specs:GridShapeSpec",
            "the radius on a grid of latitude and longitude",
        ),
        Component(
            "shape",
            "polyhedron",
            "hillsphere.model.shapes.polyhedron:PolyhedronShape",
            "hillsphere.model.shapes.specs:PolyhedronShapeSpec",
            "a closed mesh of triangles, from the mission or an OBJ file",
        ),
        Component(
            "body",
            "planet",
            "hillsphere.model.earth.planet:Planet",
            "hillsphere.model.earth.specs:PlanetSpec",
            "a planet with an ellipsoid for stations, turning as the Earth does",
        ),
        Component(
            "dispersions",
            "normal",
            "hillsphere.uncertainty.distributions:Normal",
            "hillsphere.uncertainty.specs:NormalSpec",
            "normal about the nominal value, truncated if asked, correlated if asked",
        ),
        Component(
            "dispersions",
            "uniform",
            "hillsphere.uncertainty.distributions:Uniform",
            "hillsphere.uncertainty.specs:UniformSpec",
            "equally probable in an interval",
        ),
        Component(
            "dispersions",
            "triangular",
            "hillsphere.uncertainty.distributions:Triangular",
            "hillsphere.uncertainty.specs:TriangularSpec",
            "most probable at the nominal value, zero at an interval's ends",
        ),
        Component(
            "dispersions",
            "log_normal",
            "hillsphere.uncertainty.distributions:LogNormal",
            "hillsphere.uncertainty.specs:LogNormalSpec",
            "nominal value times a factor whose logarithm is normal",
        ),
        Component(
            "dispersions",
            "choice",
            "hillsphere.uncertainty.distributions:Choice",
            "hillsphere.uncertainty.specs:ChoiceSpec",
            "one of a few values",
        ),
        Component(
            "dispersions",
            "samples",
            "hillsphere.uncertainty.samples:Samples",
            "hillsphere.uncertainty.specs:SamplesSpec",
            "rows of a table or file, drawn whole",
        ),
        Component(
            "dispersions",
            "start_covariance",
            "hillsphere.uncertainty.start_covariance:StartCovariance",
            "hillsphere.uncertainty.specs:StartCovarianceSpec",
            "initial state, normal with the covariance of its message",
        ),
        Component(
            "executor",
            "serial",
            "hillsphere.cases.executors.serial:Serial",
            "hillsphere.cases.executors.specs:SerialSpec",
            "in the process of the run, one task after the other",
        ),
        Component(
            "executor",
            "pool",
            "hillsphere.cases.executors.pool:Pool",
            "hillsphere.cases.executors.specs:PoolSpec",
            "in processes of this machine",
        ),
        Component(
            "requirement",
            "value",
            "hillsphere.show.outcomes:Value",
            "hillsphere.show.outcome_specs:ValueSpec",
            "a metric, or the cells of a table, against a value",
        ),
        Component(
            "claim",
            "statement",
            "hillsphere.show.outcomes:Statement",
            "hillsphere.show.outcome_specs:StatementSpec",
            "a statement about a metric, or the cells of a table",
        ),
        Component(
            "claim",
            "comparison",
            "hillsphere.show.outcomes:Comparison",
            "hillsphere.show.outcome_specs:ComparisonSpec",
            "a table against published values, to their printed digits",
        ),
        Component(
            "claim",
            "not_derivable",
            "hillsphere.show.outcomes:NotDerivable",
            "hillsphere.show.outcome_specs:NotDerivableSpec",
            "a statement that cannot be derived from its source",
        ),
        Component(
            "command",
            "messages",
            "hillsphere.cli.messages_command:app",
            "",
            "list the CCSDS messages of a file",
        ),
        Component(
            "command",
            "convert",
            "hillsphere.cli.convert_command:app",
            "",
            "write a file in another format for the same content",
        ),
    ]
