"""What a scene holds that Cumulo cannot honor."""


class Refused(ValueError):
    """A part of a scene that Cumulo would show as something else. The message names the object and the node, says what
    was found, and what to do."""

    def __init__(self, where, found, remedy):
        super().__init__(f"{where}: {found}; {remedy}")
        self.where, self.found, self.remedy = where, found, remedy


def named(kind, block, node=None):
    """How messages name a data block, and a node in it."""
    return f"{kind} {block.name!r}" + (f", node {node.name!r}" if node is not None else "")
