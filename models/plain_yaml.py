"""YAML of plain values: mappings, lists, texts, numbers, truth values and nothing.

What a person's file could hide behind YAML's other features is refused: aliases that unfold to
gigabytes, tags that make objects, keys given twice, and nesting that overflows the stack.
"""

from typing import Any

import yaml

from glassgait.models.errors import InputError, brief

DEEPEST = 20
"""Greatest nesting."""

LONGEST_NUMBER = 100
"""Greatest number of characters of a number."""

_PLAIN = {f"tag:yaml.org,2002:{kind}" for kind in ("null", "bool", "int", "float")}


def parse_yaml(text: str) -> Any:
    """Reads plain values from YAML text.

    Raises:
        InputError: if the text is not valid or holds more than plain values.
    """
    try:
        return yaml.load(text, Loader=_PlainLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}: " if mark else ""
        problem = where + brief(error.problem or error.context or "")
        raise InputError(f"is not valid YAML ({problem}); mend that line") from error
    except yaml.YAMLError as error:
        raise InputError(f"is not valid YAML ({brief(str(error))}); mend it") from error
    except (ValueError, OverflowError) as error:
        # Numbers such as 0b_ look like one and are none.
        raise InputError(f"holds a number that cannot be read ({brief(str(error))})") from error


def key_lines(text: str) -> dict[str, int]:
    """Finds the lines, counted from 1, of a mapping's keys and of lists' entries: `states[0]`.

    There are none where the text is no mapping that `parse_yaml` could read.
    """
    try:
        root = yaml.compose(text, Loader=_PlainLoader)
    except yaml.YAMLError:
        return {}
    lines = {}
    for key, value in root.value if isinstance(root, yaml.MappingNode) else ():
        lines[str(key.value)] = key.start_mark.line + 1
        for i, entry in enumerate(value.value if isinstance(value, yaml.SequenceNode) else ()):
            lines[f"{key.value}[{i}]"] = entry.start_mark.line + 1
    return lines


class _PlainLoader(yaml.SafeLoader):
    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [(tag, pattern) for tag, pattern in resolvers if tag in _PLAIN]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            raise _refusal(event, "anchors and aliases are not allowed")
        if event.tag is not None:
            raise _refusal(event, "tags are not allowed")
        if self._depth == DEEPEST:
            raise _refusal(event, f"it is nested more than {DEEPEST} levels deep")
        self._depth += 1
        node: Any = super().compose_node(parent, index)
        self._depth -= 1
        if node.tag in _PLAIN and len(node.value) > LONGEST_NUMBER:
            raise _refusal(event, f"a number of more than {LONGEST_NUMBER} characters")
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[str, Any]:
        mapping = {}
        for key_node, value_node in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise _refusal(key_node, "a key is not a text")
            if key in mapping:
                raise _refusal(key_node, f"key {brief(key)!r} is given twice")
            mapping[key] = self.construct_object(value_node, deep=deep)
        return mapping


def _refusal(found: Any, problem: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=found.start_mark)
