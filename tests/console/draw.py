"""The pictures of docs/console.md, from the store of the shipped one-axis campaign: `make console-pictures`."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from rigctl.console.app import Console
from tests.console.conftest import Seat

PICTURES = Path(__file__).parents[2] / "docs" / "img"
SIZE = (120, 40)


async def draw(store: Path) -> None:
    """Rig, campaign, results and workbench, as one who goes through the screens sees them."""
    app = Console(store)
    async with app.run_test(size=SIZE) as pilot:
        seat = Seat(app, pilot)

        async def picture(name: str, *words: str) -> None:
            for word in words:
                await seat.sees(word, 120.0)
            await pilot.pause(0.5)
            (PICTURES / f"console-{name}.svg").write_text(app.export_screenshot(title=f"rigctl console {store.name}"))

        await seat.until(lambda: app._view)
        await seat.press("1")
        await picture("rig", "recorded", "required")
        await seat.press("2")
        await picture("campaign", "DONE", "θ − θ0")
        await seat.press("3")
        await picture("results", "Sensing axes")
        await seat.press("4", "f")
        await picture("workbench", "theta0[", "model version 1")
        await seat.press("full_stop")
        await seat.sees("residuals / σ", 120.0)
        await seat.press("pageup")
        await picture("residuals", "residuals / σ")
        await seat.press("enter")
        await picture("run", "accel_v / V")


if __name__ == "__main__":
    asyncio.run(draw(Path(sys.argv[1])))
