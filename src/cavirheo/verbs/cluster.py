"""`cavirheo cluster check`: whether the workers of a cluster answer as this machine does."""

from __future__ import annotations

from typing import Annotated, Literal

from typer import Exit

from cavirheo.verbs import options
from cavirheo.verbs.options import argument, option


def cluster(
    action: Annotated[Literal["check"], argument("check", "whether its workers answer as this machine does")],
    scheduler: Annotated[str, option("dask: tcp://HOST:PORT, or slurm:FILE.toml")],
    quiet: options.Quiet = False,
) -> None:
    """Whether the workers of a dask cluster have the same version, compiled solver and bits as this machine."""
    from cavirheo.workflow.cluster import client_of
    from cavirheo.workflow.cluster.check import arrived, identity, reports
    from cavirheo.writing import terminal
    from cavirheo.writing.digits import MISSING

    def say(text: str) -> None:
        if not quiet:
            terminal.say(text)

    with client_of(scheduler, say) as (client, wait):
        arrived(client, wait)
        found = reports(client)
    table = terminal.table("worker", ["on", "threads", "code", "bits"], left=["on"])
    for one in found:
        who = [one.identity.code[:8], one.identity.bits[:8]] if one.identity else [MISSING] * 2
        table.add_row(one.address, one.host, str(one.threads), *who)
    if not quiet:
        terminal.console().print(table)
    for versions in sorted({one.versions for one in found if one.versions}):
        say(f"{sum(one.versions == versions for one in found)} workers with {versions}")
    for one in found:
        if one.wrong:
            terminal.say(f"refused: {one.address} on {one.host}: {one.wrong}")
    fine, mine = [one for one in found if not one.wrong], identity()
    bits = {one.identity.bits for one in fine if one.identity}
    same = "the bits of this machine" if bits == {mine.bits} else "other last bits than this machine"
    say(f"{len(fine)} of {len(found)} workers can be used, with {same} ({mine.bits[:8]})")
    if len(fine) < len(found):
        raise Exit(1)
