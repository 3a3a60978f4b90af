"""The options of the commands, for tests that run many command lines in one process."""

import copy

from cyclopts import App, ArgumentCollection

assemble = App.assemble_argument_collection
known: dict[tuple[object, ...], ArgumentCollection] = {}


def assemble_once(command: App, **options: object) -> ArgumentCollection:
    """Return the options of a command, without any words of a command line.

    cyclopts reads the signature of a command several times for each command line. This takes
    longer than most commands in the tests, and finds the same options each time.
    """
    key = (command.default_command, command.app_stack.default_parameter, *options.items())
    if key not in known:
        known[key] = assemble(command, **options)
    copies = {id(argument): copy.copy(argument) for argument in known[key]}
    for argument in copies.values():
        argument.tokens = []
        argument.children = ArgumentCollection(copies[id(child)] for child in argument.children)
    return ArgumentCollection(copies.values())
