"""The commands that help to use the others: completion, man."""

from __future__ import annotations

import click

from .help import Command, codes

SHELLS = ("bash", "zsh", "fish")


@click.command(
    cls=Command,
    short_help="Print the script that completes commands in a shell.",
    examples=(
        "bash:  echo 'eval \"$(pmsm-rs completion bash)\"' >> ~/.bashrc",
        "zsh:   echo 'eval \"$(pmsm-rs completion zsh)\"' >> ~/.zshrc",
        "fish:  pmsm-rs completion fish > ~/.config/fish/completions/pmsm-rs.fish",
    ),
    exits=codes(without=(3, 130)),
)
@click.argument("shell", type=click.Choice(SHELLS))
@click.pass_context
def completion(context: click.Context, shell: str) -> int:
    """Print the script that completes commands, options, files and names of effects in SHELL.

    SHELL is bash (4.4 or newer), zsh or fish.
    """
    from click.shell_completion import get_completion_class

    kind = get_completion_class(shell)
    assert kind is not None, "click completes in all of these shells"
    click.echo(kind(context.find_root().command, {}, "pmsm-rs", "_PMSM_RS_COMPLETE").source())
    return 0


@click.command(
    cls=Command,
    short_help="Print a manual page for man(1).",
    examples=(
        "pmsm-rs man diagnose | man -l -",
        "pmsm-rs man > ~/.local/share/man/man1/pmsm-rs.1",
    ),
    exits=codes(without=(3, 130)),
)
@click.argument(
    "name", required=False, metavar="[COMMAND]", shell_complete=lambda ctx, _, begin: _begun(ctx, begin)
)
@click.pass_context
def man(context: click.Context, name: str | None) -> int:
    """Print the manual page of pmsm-rs, or of one COMMAND, for man(1)."""
    from .._core import UsageError
    from ..errors import did_you_mean, refuse
    from .manual import page

    root = context.find_root()
    group = root.command
    assert isinstance(group, click.Group)
    if name is not None and name not in group.commands:
        raise refuse(UsageError, f"there is no command '{name}'", fix=did_you_mean(name, group.commands))
    click.echo(page(group, name))
    return 0


def _begun(context: click.Context, begin: str) -> list[str]:
    group = context.find_root().command
    assert isinstance(group, click.Group)
    return [name for name in group.list_commands(context) if name.startswith(begin)]
