"""Running a study: what is drawn, the recorder, common metrics and figures."""
