"""What Figures 6, 7, 8, 10, 11 and 13 of the paper show, as numbers; `bmd_rths_core.plots` draws them."""
