"""Tests in worker processes: campaigns, fresh tests of rules, changed failures, and the journal."""
