"""What is public and has no right call in `public_examples` yet, so that no wrong argument is tried."""

UNTRIED = {
    # vectors that solvers hand over in each of their steps
    "continuum.ExplicitOperator.complete", "continuum.ExplicitOperator.force",
    "continuum.NonlinearModel.check_increment", "continuum.NonlinearModel.commit", "continuum.NonlinearModel.force",
    "continuum.NonlinearModel.norm", "continuum.NonlinearModel.predict_stress", "continuum.NonlinearModel.step",
    "continuum.NonlinearModel.tangent",
    # seconds of a compiler for each call; a program that is not everywhere
    "continuum.law_form", "export.fmu_machine", "export.add_to_exudyn",
}  # fmt: skip
