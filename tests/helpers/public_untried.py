"""What is public and has no right call in `public_examples` yet, so that no wrong argument is tried."""

UNTRIED = {
    "Checkpoint.of", "CompiledEnergy.evaluate", "CompiledMachine.ensemble", "ControllerSamples.followed_by",
    "EquilibriumPath.q", "Event.passes", "Event.value", "ExactBeam.resultants", "Moment.set_rate", "Motion",
    "Piecewise", "Piecewise.__call__", "PseudoRigidSwarm.step", "RunSettings.method", "Slab.__call__",
    "Solid.moved", "TimeFactor.at", "beams.FrameMesh.node", "continuum.ContinuumModel.internal_work",
    "continuum.ContinuumModel.kinetic_energy", "continuum.CorotatedInterior",
    "continuum.ExplicitOperator.complete", "continuum.ExplicitOperator.force",
    "continuum.ExplicitOperator.stable_step", "continuum.NonlinearModel.check_increment",
    "continuum.NonlinearModel.commit", "continuum.NonlinearModel.force", "continuum.NonlinearModel.norm",
    "continuum.NonlinearModel.predict_stress", "continuum.NonlinearModel.restore",
    "continuum.NonlinearModel.step", "continuum.NonlinearModel.tangent", "continuum.TaggedMesh.edges",
    "continuum.TaggedMesh.vertices", "continuum.homogeneous_energy", "continuum.law_form", "continuum.on_root",
    "ensemble.Sampled.__call__", "export.Superelement.rigid_motions", "export.add_to_exudyn",
    "export.fmu_machine", "export.read_calculix", "export.read_matrix_market", "export.read_matrix_storage",
    "export.read_openfast", "export.read_triplets", "export.reduce_matrices", "force.DistributedLoad",
    "force.active_forces", "force.elastic_forces", "force.inertia_forces",
}  # fmt: skip
