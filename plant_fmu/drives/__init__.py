"""Ways of driving plants, behind the seam `plant_fmu.plants`."""
