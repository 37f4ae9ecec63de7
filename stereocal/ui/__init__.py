"""The dashboard's own pieces: the only part of the package that imports streamlit."""
