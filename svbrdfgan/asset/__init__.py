"""The user's file: read whole, judged, edited and written again, with nothing changed but what weathers."""
