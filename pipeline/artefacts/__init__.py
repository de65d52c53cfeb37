"""Files that the pipeline reads and writes, each format in one module.

- Whole files and their digests: `files`, `stamps`, `stamp_parts`, `job_lock`, `run_lock`.
- A study's layout and results: `folders`, `results`, `*_results`, `evidence`, `failure_counts`,
  `likelihood`, `model_card`, `filter_table`, `scenario_space`.
- Campaigns and images: `tables`, `points`, `recorded_tests`, `dataset`, `frame_tags`,
  `frame_export`, `openlabel`, `openscenario`.
- Spaces: `space_formats` reads every format, `model_export` writes them; behind these stand
  `space_file`, `pict_*`, `acts_*` and `odd_*`.
- Points of a space: `point_table` reads every source; behind it stand `table_file`, `csv_batches`,
  `table_categories`, `sequence_table`, `image_sets` and the readers of data sets.
"""
