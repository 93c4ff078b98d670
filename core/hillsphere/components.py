"""The components that the core itself brings, registered like those of any plugin."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the core's components."""
    return [
        Component(
            "body",
            "moon",
            "hillsphere.bodies:Moon",
            "hillsphere.bodies:MoonSpec",
            "a small moon on a Keplerian orbit around its primary",
        ),
        Component(
            "body",
            "asteroid",
            "hillsphere.bodies:Moon",
            "hillsphere.bodies:AsteroidSpec",
            "an asteroid with a spin of its own on a Keplerian orbit around the Sun",
        ),
        Component(
            "body",
            "solar_orbit",
            "hillsphere.ephemeris:KeplerOrbit",
            "hillsphere.ephemeris_specs:KeplerOrbitSpec",
            "a planet or spacecraft on a Keplerian orbit around the Sun, for ephemerides",
        ),
        Component(
            "body",
            "spice",
            "hillsphere.spice:SpiceOrbit",
            "hillsphere.ephemeris_specs:SpiceOrbitSpec",
            "a body where a SPICE kernel says that it is (extra 'spice')",
        ),
        Component(
            "shape",
            "ellipsoid",
            "hillsphere.shapes.ellipsoid:EllipsoidShape",
            "hillsphere.shapes.specs:EllipsoidShapeSpec",
            "a tri-axial ellipsoid",
        ),
        Component(
            "shape",
            "harmonics",
            "hillsphere.shapes.harmonic:HarmonicShape",
            "hillsphere.shapes.specs:HarmonicShapeSpec",
            "the radius as a series of spherical harmonics",
        ),
        Component(
            "shape",
            "grid",
            "hillsphere.shapes.grid:GridShape",
            "hillsphere.shapes.specs:GridShapeSpec",
            "the radius on a grid of latitude and longitude",
        ),
        Component(
            "shape",
            "polyhedron",
            "hillsphere.shapes.polyhedron:PolyhedronShape",
            "hillsphere.shapes.specs:PolyhedronShapeSpec",
            "a closed mesh of triangles, from the mission or an OBJ file",
        ),
        Component(
            "body",
            "planet",
            "hillsphere.earth.planet:Planet",
            "hillsphere.earth.specs:PlanetSpec",
            "a planet with an ellipsoid for stations, turning as the Earth does",
        ),
        Component(
            "stage",
            "closed_loop",
            "hillsphere.closed_loop.stage:ClosedLoopStage",
            "hillsphere.closed_loop.specs:ClosedLoopSpec",
            "a plant under a law that follows a reference; can be repeated by campaigns",
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
            "stage",
            "monte_carlo",
            "hillsphere.campaign.stages:MonteCarlo",
            "hillsphere.campaign.specs:MonteCarloSpec",
            "many cases of another stage, with what is uncertain drawn at random",
        ),
        Component(
            "stage",
            "sweep",
            "hillsphere.campaign.stages:Sweep",
            "hillsphere.campaign.specs:SweepSpec",
            "another stage at chosen points, with many cases at each if asked",
        ),
        Component(
            "stage",
            "campaign_comparison",
            "hillsphere.campaign.comparison:CampaignComparisonStage",
            "hillsphere.campaign.comparison_specs:CampaignComparisonSpec",
            "campaigns on the same random numbers, compared case by case",
        ),
        Component(
            "stage",
            "campaign_summary",
            "hillsphere.campaign.summary:CampaignSummaryStage",
            "hillsphere.campaign.summary_specs:CampaignSummarySpec",
            "campaigns side by side, beside published values, with answers to what is claimed",
        ),
        Component(
            "command",
            "export",
            "hillsphere.campaign.export_command:app",
            "",
            "Write the cases of a campaign to a file for other programs.",
        ),
        Component(
            "executor",
            "serial",
            "hillsphere.campaign.executors.serial:Serial",
            "hillsphere.campaign.executors.specs:SerialSpec",
            "in the process of the run, one task after the other",
        ),
        Component(
            "executor",
            "pool",
            "hillsphere.campaign.executors.pool:Pool",
            "hillsphere.campaign.executors.specs:PoolSpec",
            "in processes of this machine",
        ),
        Component(
            "executor",
            "dask",
            "hillsphere.campaign.executors.dask:Dask",
            "hillsphere.campaign.executors.dask_specs:DaskSpec",
            "in workers of dask.distributed, here or on a cluster",
        ),
    ]
