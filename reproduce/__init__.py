"""The paper, regenerated: scales, stages, one file a table or figure, and the Snakemake workflow that drives them."""
