"""A person as the tutor: sessions kept in a log, whole-number questions, and hosts.

``session`` is built on an asker and a log. ``showing`` words a question. ``interview`` takes the
messages of every host and says which screen is next; ``drawing`` fills the screens, and in a
browser the files of ``page`` draw them. ``next_question`` chooses questions beside the asker's, and
``beside`` computes in a thread what follows each answer. ``course`` decides what comes next.
``report`` is the page that the person keeps. ``study`` is several people at once. Imports from
every folder of ``elicit``; only ``study`` needs ``diagnostics``. A host's further dependencies are
imported late.
"""
