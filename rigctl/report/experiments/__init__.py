"""What each experiment prints and draws: `rigctl.report.drawn.Drawing`, named by its declaration."""
