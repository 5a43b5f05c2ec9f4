"""Replays: a rollout drawn again, as a page that opens without a server."""

from pathlib import Path

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from glassgait.diagrams.rollout import Rollout, set_plant_state
from glassgait.models.files import write_atomically
from glassgait.models.task import CONTROL_PERIOD
from glassgait.systems.gait_display import GaitDisplay


def save_replay(
    diagram: Diagram, meshcat: Meshcat, rollout: Rollout, path: Path, *, repetitions: int = 1
) -> None:
    """Draws every recorded control step into an animation and writes its page, atomically.

    The page is as long as what was recorded, however long the robot has walked in view.

    Args:
        diagram: What `MakeLocomotion` built to show in `meshcat`.
        meshcat: Where the robot shows.
        rollout: What it did; its first instant is the replay's time 0.
        path: HTML file of the replay.
        repetitions: How often it plays before it stands still.
    """
    context = diagram.CreateDefaultContext()
    display = diagram.GetSubsystemByName("gait_display")
    assert isinstance(display, GaitDisplay)
    own = display.GetMyMutableContextFromRoot(context)
    meshcat.DeleteRecording()
    meshcat.StartRecording(
        frames_per_second=1.0 / CONTROL_PERIOD, set_visualizations_while_recording=False
    )
    samples = zip(rollout.time, rollout["state"], rollout["rm_state"], strict=True)
    for time, state, rm_state in samples:
        context.SetTime(time - rollout.time[0])
        set_plant_state(diagram, context, state)
        # The machine's history is not recorded, only its state.
        display.GetInputPort("rm_state").FixValue(own, rm_state)
        diagram.ForcedPublish(context)
    meshcat.StopRecording()
    meshcat.get_mutable_recording().set_repetitions(repetitions)
    meshcat.PublishRecording()
    write_atomically(path, replay_page(meshcat))


def replay_page(meshcat: Meshcat) -> str:
    """Returns what Meshcat shows as a page that opens without a server.

    Its language and its controls are named, for those who hear a page.

    A page around it may ask for a moment: by the message `{replay: seconds}`. Browsers let pages of
    other files send messages, and nothing else.
    """
    page, end = meshcat.StaticHtml(), "</body>"
    for plain, named in _NAMED:
        page = page.replace(plain, named, 1)
    start = page.rindex(end) if end in page else len(page)
    return f"{page[:start]}{_FOLLOWING}{page[start:]}"


_NAMED = (
    ("<html>", '<html lang="en">'),
    ("<title>", '<meta name="viewport" content="width=device-width, initial-scale=1"><title>'),
    ("Drake MeshCat", "Replay"),
)

_FOLLOWING = """<script>
window.addEventListener("message", event => {
  const seconds = event.data && event.data.replay;
  if (typeof seconds !== "number" || typeof viewer === "undefined" || !viewer.animator) return;
  viewer.animator.pause();
  viewer.animator.seek(seconds);
});
if (window.parent !== window) {
  // Meshcat begins to play once it has loaded, which it does not announce.
  const announce = () => window.parent.postMessage({replay: "ready"}, "*");
  for (const wait of [0, 400, 1500, 4000]) setTimeout(announce, wait);
}
else if (matchMedia("(prefers-reduced-motion: reduce)").matches)
  for (const wait of [0, 400, 1500]) setTimeout(() => viewer.animator?.pause(), wait);
// A control is called by the words of its line, or of the folder that it stands in.
const label = () => {
  for (const own of document.querySelectorAll(".dg :is(input, select):not([aria-label])")) {
    const line = own.closest("li")?.querySelector(".property-name, .title");
    const words = line ?? own.closest(".dg")?.querySelector(".title");
    own.setAttribute("aria-label", words?.textContent.trim() || "control of the replay");
  }
};
addEventListener("load", () => {
  label();
  new MutationObserver(label).observe(document.body, {childList: true, subtree: true});
});
</script>
"""
