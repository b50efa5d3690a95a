"""A person as the tutor: sessions kept in a log, questions in whole numbers, and the hosts that put them.

``session`` stands on an asker and a log; ``showing`` words a question; ``interview`` is what every host draws and
answers, in a browser by the files of ``page``; ``report`` is what the person keeps. Imports from every folder of
``elicit`` but ``diagnostics``; what the hosts need beyond the base is imported late.
"""
