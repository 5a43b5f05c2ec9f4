"""Code that studies share: episodes, scores, policies, run folders, experiments, figures."""
