"""What a loop is tuned with, whoever flies it: linear models, blocks, margins, the search for gains."""
