"""What the README shows must run as shown."""

import re
from pathlib import Path

from models.task.gait import parse_gait

TEXT = (Path(__file__).parents[1] / "README.md").read_text()


def block(language):
    found = re.findall(rf"```{language}\n(.*?)```", TEXT, flags=re.DOTALL)
    assert found
    return found


def test_the_example_runs(capsys):
    (example,) = block("python")
    exec(compile(example, "README.md", "exec"), {})
    assert "(501, 2) False" in capsys.readouterr().out


def test_the_gait_of_ones_own_is_accepted():
    (text,) = block("yaml")
    gait = parse_gait(text, name="hop")
    assert gait.transitions[0].when.swing_feet == (True,) * 4


def test_every_picture_and_page_is_there():
    root = Path(__file__).parents[1]
    for found in re.findall(r'src="([^"]+)"|\]\(((?!http)[^)]+)\)', TEXT):
        path, _, heading = "".join(found).partition("#")
        assert (root / path).exists()
        if heading:
            titles = re.findall(r"^#+ (.*)$", (root / path).read_text(), flags=re.MULTILINE)
            assert heading in {title.lower().replace(" ", "-") for title in titles}
