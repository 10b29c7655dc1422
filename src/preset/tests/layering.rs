//! Which layer wins.

use super::*;

#[test]
fn the_nearest_file_wins_and_lists_are_replaced() {
    let files = [
        (
            "gltf-lod.toml",
            "levels = [0.9, 0.8]\nscreen_height = 2160\npixel_tolerance = 3\n[gates]\nmax_error = '1%'\n",
        ),
        ("a/gltf-lod.toml", "levels = [0.3]\npixel_tolerance = 2\n[gates]\nmax_gap_edges = 7\n"),
        ("a/b/gltf-lod.toml", "pixel_tolerance = 4\n"),
        ("z/gltf-lod.toml", "screen_height = 1\n"),
    ];
    let deep = settings(&files, "a/b/c/chair.glb");
    assert_eq!(ratios(&deep), [0.3]);
    assert_eq!((deep.screen_height, deep.pixel_tolerance), (2160.0, 4.0));
    assert_eq!(deep.gates.max_error, Some((ErrorBound::Percent(1.0), Severity::Fail)));
    assert_eq!(deep.gates.max_gap_edges, Some((7, Severity::Fail)));
    assert_eq!(deep.gates.max_rms_vs_meshopt, Some((1.0, Severity::Warn)), "from default.toml");
    let top = settings(&files, "chair.glb");
    assert_eq!((ratios(&top), top.pixel_tolerance), (vec![0.9, 0.8], 3.0));
}

#[test]
fn files_above_the_root_do_not_count() {
    let root = directory(&[("gltf-lod.toml", "screen_height = 1"), ("in/a.glb", "")]);
    let presets = Presets::new(&Flags::default()).unwrap();
    let input = root.path().join("in");
    let settings = presets.for_asset(&input, Path::new("a.glb")).unwrap().settings(&MeshNames::default()).unwrap();
    assert_eq!(settings.screen_height, 1080.0);
}

#[test]
fn config_wins_over_files_and_flags_over_all() {
    let config = directory(&[(
        "ci.toml",
        "levels = [0.4]\nalgorithm = 'qem'\nscreen_height = 100\n[preset.ci]\nscreen_height = 300\n",
    )]);
    let files = [("a/gltf-lod.toml", "levels = [0.9]\nalgorithm = 'esqem'\nscreen_height = 200\ncull_coverage = 0.5")];
    let mut flags = Flags { config: Some(config.path().join("ci.toml")), ..Flags::default() };
    let with = |flags: &Flags| read_with(flags, &files, "a/a.glb").unwrap().settings(&MeshNames::default()).unwrap();
    let settings = with(&flags);
    assert_eq!((ratios(&settings), settings.screen_height, settings.cull_coverage), (vec![0.4], 100.0, 0.5));
    assert_eq!(settings.simplify.algorithm, simplify::Algorithm::Qem);
    flags.preset = Some("ci".into());
    assert_eq!(with(&flags).screen_height, 300.0);
    flags.preset = Some("mobile".into());
    assert_eq!((with(&flags).screen_height, ratios(&with(&flags))), (720.0, vec![0.4, 0.15, 0.06, 0.03]));
    flags.levels = Some(vec![0.2]);
    flags.algorithm = Some("esqem".into());
    let settings = with(&flags);
    assert_eq!(ratios(&settings), [0.2]);
    assert_eq!(settings.simplify.algorithm, simplify::Algorithm::Esqem(simplify::Mode::Enhanced));
}

#[test]
fn later_and_nearer_rules_win() {
    let files = [
        (
            "gltf-lod.toml",
            "screen_height = 10\n[[rule]]\nmesh = 'a*'\nscreen_height = 11\npixel_tolerance = 11\n[[rule]]\nmesh = 'ab*'\nscreen_height = 12\n",
        ),
        ("d/gltf-lod.toml", "pixel_tolerance = 20\n[[rule]]\nmesh = '*c'\nscreen_height = 21\n"),
    ];
    let height = |asset, name| read(&files, asset).settings(&mesh(name)).unwrap().screen_height;
    assert_eq!((height("x.glb", "z"), height("x.glb", "a"), height("x.glb", "abc")), (10.0, 11.0, 12.0));
    assert_eq!((height("d/x.glb", "ab"), height("d/x.glb", "abc")), (12.0, 21.0));
    let tolerance = read(&files, "d/x.glb").settings(&mesh("a")).unwrap().pixel_tolerance;
    assert_eq!(tolerance, 20.0, "a nearer file's keys win over the rules of a farther one");
}

#[test]
fn rules_match_paths_and_all_kinds_of_names() {
    let text = "[[rule]]\npath = 'my props/**'\nnode = ['Tür *', 'gate']\nmaterial = 'glass*'\nskip = true\n";
    let files = [("d/gltf-lod.toml", text)];
    let skip = |asset, nodes: &[&str], materials: &[&str]| {
        let owned = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<_>>();
        let (nodes, materials) = (owned(nodes), owned(materials));
        read(&files, asset).settings(&MeshNames { mesh: None, nodes: &nodes, materials: &materials }).unwrap().skip
    };
    let reason = Some("`skip` in d/gltf-lod.toml, line 5".to_owned());
    assert_eq!(skip("d/my props/x/türen.glb", &["wall", "Tür links"], &["wood", "glass.001"]), reason);
    assert_eq!(skip("d/my props/x/türen.glb", &["gate"], &["glass"]), reason);
    assert_eq!(skip("d/my props/x/türen.glb", &["gate 2"], &["glass"]), None);
    assert_eq!(skip("d/my props/x/türen.glb", &["gate"], &[]), None);
    assert_eq!(skip("d/other/türen.glb", &["gate"], &["glass"]), None);
    assert_eq!(skip("my props/türen.glb", &["gate"], &["glass"]), None);
}

#[test]
fn skip_can_be_taken_back() {
    let files = [
        ("gltf-lod.toml", "skip = true\n[[rule]]\nmesh = 'hero'\nskip = false\n"),
        ("a/gltf-lod.toml", "skip = false"),
    ];
    assert_eq!(settings(&files, "x.glb").skip.as_deref(), Some("`skip` in gltf-lod.toml, line 1"));
    assert_eq!(read(&files, "x.glb").settings(&mesh("hero")).unwrap().skip, None);
    assert_eq!(settings(&files, "a/x.glb").skip, None);
}

#[test]
fn presets_build_on_each_other() {
    let files = [
        (
            "gltf-lod.toml",
            "[preset.tablet]\nextends = ['mobile', 'foliage']\nscreen_height = 1600\n[[preset.tablet.rule]]\nmesh = 'flag'\nborder = 'lock'\n",
        ),
        ("a/gltf-lod.toml", "extends = 'tablet'\nlevels = [0.5]\n[[rule]]\npath = 'h*.glb'\nextends = 'hero'\n"),
    ];
    let tablet = settings(&files, "a/x.glb");
    assert_eq!((tablet.screen_height, tablet.cull_coverage), (1600.0, 0.005), "foliage comes after mobile");
    assert_eq!(tablet.min_saving, 0.75, "from mobile");
    assert_eq!(ratios(&tablet), [0.5], "keys beside `extends` win");
    assert_eq!(tablet.simplify.split_factor, None, "from foliage");
    let flag = read(&files, "a/x.glb").settings(&mesh("flag")).unwrap();
    assert_eq!(flag.simplify.border, simplify::EdgePolicy::Lock);
    let hero = settings(&files, "a/hero.glb");
    assert_eq!((hero.screen_height, hero.levels.len()), (2160.0, 6), "a rule's `extends` wins over the file's keys");
    // Names are seen from where they stand outwards: the root file does not know what a nearer one defines.
    let files = [("gltf-lod.toml", "extends = 'mine'"), ("a/gltf-lod.toml", "[preset.mine]\nskip = true")];
    assert!(read_with(&Flags::default(), &files, "a/x.glb").unwrap_err().message.contains("unknown preset `mine`"));
}

#[test]
fn what_holds_for_whole_files_does_not_change_from_mesh_to_mesh() {
    let text = "naming = '{level}'\n[[rule]]\nmesh = 'a'\nextends = 'default'\n[[rule]]\npath = 'b.glb'\nnaming = 'b{level}'\n";
    let files = [("gltf-lod.toml", text)];
    let naming = |asset, name| read(&files, asset).settings(&mesh(name)).unwrap().naming;
    assert_eq!((naming("a.glb", "a"), naming("b.glb", "a")), ("{level}".to_owned(), "b{level}".to_owned()));
}

#[test]
fn extending_default_starts_afresh() {
    let files = [("gltf-lod.toml", "extends = 'mobile'"), ("a/gltf-lod.toml", "extends = 'default'")];
    assert_eq!(settings(&files, "a/x.glb"), Settings::default());
}

#[test]
fn copies_are_relative_to_their_file_and_the_nearest_list_wins() {
    let files = [("gltf-lod.toml", "copy = ['*.txt', '/docs/']"), ("a b/gltf-lod.toml", "copy = ['ü/*.png']")];
    let copies = |path: &str| read(&files, path).copies(Path::new(path));
    assert!(copies("x.txt") && copies("c/x.txt") && copies("docs/c/x.pdf"));
    assert!(!copies("c/docs/x.pdf") && !copies("x.png"));
    assert!(copies("a b/ü/x.png"));
    assert!(!copies("a b/x.txt") && !copies("a b/x.png"));
}

#[test]
fn levels_come_in_every_spelling() {
    let text = "levels = [0.5, { ratio = 0.4, error = 0.02 }, { triangles = 500, error = ' 1.5 %' }, { pixels = 2, at = 0.1 }]";
    let levels = settings(&[("gltf-lod.toml", text)], "x.glb").levels;
    assert_eq!(
        levels[1],
        LevelTarget { ratio: Some(0.4), error: Some(ErrorBound::Units(0.02)), ..LevelTarget::default() }
    );
    assert_eq!((levels[2].triangles, levels[2].error), (Some(500), Some(ErrorBound::Percent(1.5))));
    assert_eq!(levels[3].pixels, Some(PixelBound { pixels: 2.0, at: 0.1 }));
    let tables = "[[levels]]\nratio = 0.5\n[[levels]]\nratio = 0.25\n";
    assert_eq!(ratios(&settings(&[("gltf-lod.toml", tables)], "x.glb")), [0.5, 0.25]);
    assert!(settings(&[("gltf-lod.toml", "levels = []")], "x.glb").levels.is_empty());
    // The same floor under several error caps is a chain, too.
    let floors = "levels = [{ ratio = 0.1, error = 0.1 }, { ratio = 0.1, error = 0.2 }]";
    assert_eq!(settings(&[("gltf-lod.toml", floors)], "x.glb").levels.len(), 2);
}

#[test]
fn gates_and_splits_can_be_switched_off() {
    let text = "split_factor = false\n[gates]\nmax_gap_edges = false\nmax_rms_vs_meshopt = { value = 2, on = 'warn' }";
    let settings = settings(&[("gltf-lod.toml", text)], "x.glb");
    assert_eq!(settings.simplify.split_factor, None);
    assert_eq!(settings.gates.max_gap_edges, None);
    assert_eq!(settings.gates.max_rms_vs_meshopt, Some((2.0, Severity::Warn)));
}

#[test]
fn a_file_is_read_once_whatever_the_thread() {
    let root = directory(&[("gltf-lod.toml", "screen_height = 500")]);
    let presets = Presets::new(&Flags::default()).unwrap();
    let height = |asset: usize| {
        let below = format!("d{}/x.glb", asset % 3);
        presets
            .for_asset(root.path(), Path::new(&below))
            .unwrap()
            .settings(&MeshNames::default())
            .unwrap()
            .screen_height
    };
    assert_eq!(height(0), 500.0);
    fs::write(root.path().join("gltf-lod.toml"), "screen_height = 600").unwrap();
    std::thread::scope(|scope| {
        let heights: Vec<_> = (0..6).map(|asset| scope.spawn(move || height(asset))).collect();
        assert!(heights.into_iter().all(|height| height.join().unwrap() == 500.0));
    });
}
