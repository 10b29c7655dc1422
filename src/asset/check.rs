//! The structural pass: every index, range, type and graph is checked here before anything else looks at the document.
