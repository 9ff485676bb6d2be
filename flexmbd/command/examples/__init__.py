"""Scenes to begin with, as texts, which `flexmbd example` writes into a folder."""

from flexmbd.command.examples.bouncing_ball import BOUNCING_BALL
from flexmbd.command.examples.four_bar import FOUR_BAR
from flexmbd.command.examples.scene_folder import SceneFolder as SceneFolder
from flexmbd.command.examples.slider_crank import SLIDER_CRANK
from flexmbd.command.examples.spring_pendulum import SPRING_PENDULUM

#: By their names.
EXAMPLES: dict[str, SceneFolder] = {
    one.name: one for one in (SLIDER_CRANK, SPRING_PENDULUM, FOUR_BAR, BOUNCING_BALL)
}
