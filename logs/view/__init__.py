"""A flight as one self-contained page: `write_page` of `logs.view.page`."""
