"""A flight as one HTML page: `write_page` of `logs.view.page`."""
