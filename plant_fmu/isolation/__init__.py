"""Plants in processes of their own, behind the same seam."""
