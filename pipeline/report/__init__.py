"""Pages, plots and films of a study, and the texts that commands print.

`contents` makes the report, `evidence_page` and `front_car_page` the other pages, `page` renders
them as HTML. The modules called `*_plots` draw figures, `replays` and `films` write videos,
`verdict` and `coverage_texts` print to the terminal, `report_server` serves a report.
"""
