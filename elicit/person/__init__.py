"""A person as the tutor: sessions kept in a log, whole-number questions, and hosts.

``session`` is built on an asker and a log. ``showing`` has the subject in words, and words a
question. ``interview`` takes the messages of every host and says which screen is next. It has four
parts: ``next_question`` chooses questions beside the asker's, ``mending`` settles conflicts and
takes answers back, ``drawing`` fills the screens other than a question, and ``beside`` computes in
a thread what follows each answer. In a browser the files of ``page`` draw the screens. ``course``
decides what comes next. ``report`` is the page that the person keeps. ``study`` is several people
at once. Imports from every folder of ``elicit``; only ``study`` needs ``diagnostics``. A host's
further dependencies are imported late.
"""
