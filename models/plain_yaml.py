"""YAML of plain values, read by `yaml.SafeLoader`.

Aliases, which may unfold to gigabytes, tags and keys given twice are refused. A date is text.
"""

from typing import Any

import yaml

from glassgait.models.errors import InputError, brief


def parse_yaml(text: str) -> Any:
    """Reads plain values from YAML text.

    Raises:
        InputError: if the text is not valid or holds more than plain values.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}: " if mark else ""
        problem = where + brief(error.problem or error.context or "")
        raise InputError(f"is not valid YAML ({problem}); mend that line") from error
    except yaml.YAMLError as error:
        raise InputError(f"is not valid YAML ({brief(str(error))}); mend it") from error
    except (ValueError, OverflowError) as error:
        raise InputError(f"holds a number that cannot be read ({brief(str(error))})") from error
    except RecursionError as error:
        raise InputError("is nested too deep; mend it") from error


class _Loader(yaml.SafeLoader):
    """Safe YAML without aliases, tags, dates and keys that are given twice."""

    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [own for own in resolvers if not own[0].endswith((":timestamp", ":merge"))]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            raise _refusal(event, "anchors and aliases are not allowed")
        if event.tag is not None:
            raise _refusal(event, "tags are not allowed")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _refusal(key, "a key is not a text")
            if key.value in seen:
                raise _refusal(key, f"key {brief(key.value)!r} is given twice")
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _refusal(found: Any, problem: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=found.start_mark)
