//! The room as a whole: errors with their places, layers, shipped presets, schema.

use super::*;
use crate::Error;
use std::fs;
use std::path::Path;

/// Writes `files` into a fresh directory.
fn directory(files: &[(&str, &str)]) -> tempfile::TempDir {
    let root = tempfile::tempdir().unwrap();
    for (path, text) in files {
        let path = root.path().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    root
}

fn read_with(flags: &Flags, files: &[(&str, &str)], asset: &str) -> Result<AssetPresets, Error> {
    let root = directory(files);
    Presets::new(flags)?.for_asset(root.path(), &root.path().join(asset))
}

fn read(files: &[(&str, &str)], asset: &str) -> AssetPresets {
    read_with(&Flags::default(), files, asset).unwrap_or_else(|error| panic!("{error}"))
}

fn settings(files: &[(&str, &str)], asset: &str) -> Settings {
    read(files, asset).settings(&MeshNames::default()).unwrap()
}

fn mesh(name: &str) -> MeshNames<'_> {
    MeshNames { mesh: Some(name), ..MeshNames::default() }
}

/// Place and picture of the error in a file.
fn error_in(text: &str) -> (String, String) {
    let error = read_with(&Flags::default(), &[(FILE_NAME, text)], "a.glb")
        .and_then(|presets| presets.settings(&MeshNames::default()))
        .expect_err(text);
    assert_eq!(error.kind, crate::Kind::Preset);
    assert!(error.file.unwrap().ends_with(FILE_NAME));
    (error.place.unwrap(), error.message)
}

fn ratios(settings: &Settings) -> Vec<f64> {
    settings.levels.iter().filter_map(|level| level.ratio).collect()
}

mod errors {
    use super::*;

    #[test]
    fn a_message_shows_the_line_with_carets_and_the_way_out() {
        let (place, picture) = error_in("levels = [0.5]\nscreen_hight = 720 # Höhe\n");
        assert_eq!(place, "line 2, column 1");
        assert_eq!(
            picture,
            "unknown key `screen_hight`
  |
2 | screen_hight = 720 # Höhe
  | ^^^^^^^^^^^^
  |
  = help: did you mean `screen_height`?"
        );
    }

    #[test]
    fn columns_count_characters_and_carets_count_cells() {
        let (place, picture) = error_in("\u{feff}description = \"äöü漢字🦀\" oops\n");
        assert_eq!(place, "line 1, column 24");
        // 漢, 字 and 🦀 are two cells wide.
        let caret = picture.lines().nth(3).unwrap();
        assert_eq!(caret, format!("  | {}^", " ".repeat(23 + 3)));
        let (place, _) =
            error_in("description = \"a\"\r\n\r\n[preset.\"漢字\"]\r\nextends = [\"möbel\", \"wände\"]\r\n");
        assert_eq!(place, "line 4, column 12");
    }

    #[test]
    fn every_class_points_at_its_place_and_says_what_to_write() {
        let cases = [
            // Unknown keys and words.
            ("ratio = 0.5", "1:1", 5, "unknown key `ratio`", "did you mean `levels`?"),
            ("[[level]]\nratio = 0.5", "1:3", 5, "unknown key `level`", "did you mean `levels`?"),
            ("[[levels]]\nrato = 0.5", "2:1", 4, "unknown key `rato`", "did you mean `ratio`?"),
            ("[[rules]]\nmesh = 'a'", "1:3", 5, "unknown key `rules`", "did you mean `rule`?"),
            ("[[rule]]\nmaterail = 'a'", "2:1", 8, "unknown key `materail`", "did you mean `material`?"),
            ("[gates]\nmax_eror = 3", "2:1", 8, "unknown key `max_eror`", "did you mean `max_error`?"),
            (
                "[gates]\nspeed = 3",
                "2:1",
                5,
                "unknown key `speed`",
                "there is `max_error`, `max_rms_vs_meshopt`, `max_gap_edges`",
            ),
            (
                "attribute_weights = { uv = 1 }",
                "1:23",
                2,
                "unknown key `uv`",
                "there is `normal`, `tex_coord`, `color`",
            ),
            ("[preset.a]\nlevles = []", "2:1", 6, "unknown key `levles`", "did you mean `levels`?"),
            ("algorithm = 'esqm'", "1:13", 6, "unknown value `esqm`", "did you mean `esqem`?"),
            ("border = 'locked'", "1:10", 8, "unknown value `locked`", "did you mean `lock`?"),
            ("layout = 'appended'", "1:10", 10, "unknown value `appended`", "did you mean `append`?"),
            // Types.
            ("algorithm = 3", "1:13", 1, "expected a word in quotes", ""),
            ("algorithm = qem", "1:13", 3, "text must stand in quotes", ""),
            ("skip = 'yes'", "1:8", 5, "expected true or false, found `'yes'`", ""),
            ("skip =", "1:7", 1, "a value is missing", ""),
            ("screen_height = '4k'", "1:17", 4, "expected a number from 1 to 100000, found `'4k'`", ""),
            ("levels = 0.5", "1:10", 3, "expected a list of levels such as [0.5, 0.25]", ""),
            ("levels = ['half']", "1:11", 6, "expected a level: a share of the triangles", ""),
            ("[rule]\nmesh = 'a'", "1:1", 6, "expected a table `[[rule]]` with double brackets", ""),
            ("[levels]\nratio = 0.5", "1:1", 8, "expected a list of levels such as [0.5, 0.25]", ""),
            ("extends = 3", "1:11", 1, "expected a string or a list of strings, found `3`", ""),
            ("samples = 1000.5", "1:11", 6, "expected a whole number from 100 to 10000000, found `1000.5`", ""),
            // Ranges.
            ("pixel_tolerance = 0", "1:19", 1, "expected a number above 0 and at most 1000, found `0`", ""),
            ("cull_coverage = nan", "1:17", 3, "expected a number from 0 to 0.99, found `nan`", ""),
            ("min_triangles = 0", "1:17", 1, "expected a whole number from 1, found `0`", ""),
            ("min_triangles = 99999999999999999999", "1:17", 20, "expected a whole number from 1, found", ""),
            (
                "split_factor = 0.5",
                "1:16",
                3,
                "expected a number from 1 to 100, or false for no splits, found `0.5`",
                "",
            ),
            (
                "levels = [500]",
                "1:11",
                3,
                "is a share of the triangles",
                "for a number of triangles write { triangles = 500 }",
            ),
            ("levels = [{ triangles = 0 }]", "1:25", 1, "expected a whole number from 1, found `0`", ""),
            ("levels = [{ error = '0.5' }]", "1:21", 5, "such as \"0.5%\", found `'0.5'`", ""),
            ("[gates]\nmax_error = true", "2:13", 4, "expected a limit, a table such as", ""),
            (
                "[gates]\nmax_error = { value = '1%', on = 'fial' }",
                "2:34",
                6,
                "unknown value `fial`",
                "did you mean `fail`?",
            ),
            ("[gates]\nmax_error = { on = 'fail' }", "2:13", 15, "missing key `value`", ""),
            ("[gates]\nmax_gap_edges = -1", "2:17", 2, "expected a whole number from 0, found `-1`", ""),
            // Values that do not fit together.
            ("levels = [0.5, 0.6]", "1:16", 3, "by its `ratio` this level is finer", "levels go from fine to coarse"),
            ("levels = [0.5, 0.5]", "1:16", 3, "by its `ratio` this level equals", "levels go from fine to coarse"),
            ("[[levels]]\nratio = 0.5\n[[levels]]\nratio = 0.6", "3:1", 10, "this level is finer", "fine to coarse"),
            ("levels = [{ error = '1%' }, { error = '0.5%' }]", "1:29", 18, "by its `error` this level is finer", ""),
            ("levels = [{}]", "1:11", 2, "this level has no rule that ends it", "add `ratio`, `triangles`"),
            ("levels = [{ pixels = 1 }]", "1:11", 14, "`pixels` needs `at`", "`at = 0.25`"),
            ("levels = [{ ratio = 0.5, at = 1 }]", "1:11", 23, "`at` belongs to `pixels`", ""),
            ("coverage = [0.5, 0.5]", "1:18", 3, "coverage has to fall", ""),
            ("coverage = [0.5, 0.2]", "1:12", 10, "2 coverage numbers for 3 levels", "one number for each level"),
            ("coverage = [0.5, 0.2, 0.1]\ncull_coverage = 0.1", "1:12", 15, "the last level would be culled", ""),
            ("naming = '{nam}_{level}'", "1:10", 15, "unknown word `{nam}`", "`{name}` and `{level}`"),
            ("naming = '{name}_LOD'", "1:10", 12, "all levels would have the same name", "add `{level}`"),
            // Patterns and rules.
            ("[[rule]]\nmesh = 'a['\nskip = true", "2:8", 4, "not a pattern: unclosed character class", "`[[]`"),
            ("[[rule]]\npath = ['a', '../b']\nskip = true", "2:14", 6, "cannot leave it", "higher up"),
            ("copy = ['a', 'b\\c']", "1:14", 5, "`/` between directories", ""),
            ("[[rule]]\nskip = true", "1:1", 8, "this rule has no condition", "add `path`, `node`"),
            ("[[rule]]\nmesh = 'a'", "1:1", 8, "this rule sets nothing", "`skip = true`"),
            // Names.
            ("extends = 'mobil'", "1:11", 7, "unknown preset `mobil`", "did you mean `mobile`?"),
            ("extends = ['mobile', 'xyz']", "1:22", 5, "unknown preset `xyz`", "there is `character`, `default`"),
            ("[preset.tablet]\nextends = 'tablett'", "2:11", 9, "unknown preset `tablett`", "did you mean `tablet`?"),
            ("[preset.mobile]\nskip = true", "1:9", 6, "`mobile` is a built-in preset", "choose another name"),
            ("[preset.a]\nextends = 'a'", "2:11", 3, "in a circle: a → a", "remove one `extends`"),
            ("[preset.a]\nextends='b'\n[preset.b]\nextends=['hero', 'a']", "4:18", 3, "in a circle: a → b → a", ""),
            // TOML itself.
            ("levels = [0.5\nskip = true", "2:1", 1, "missing comma between array elements", ""),
            ("skip = true\nskip = true", "2:1", 4, "duplicate key", ""),
        ];
        for (text, place, carets, title, help) in cases {
            let (found, picture) = error_in(text);
            let (line, column) = place.split_once(':').unwrap();
            assert_eq!(found, format!("line {line}, column {column}"), "{text}\n{picture}");
            let first = picture.lines().next().unwrap();
            assert!(first.contains(title), "{text}\n{picture}");
            let margin = " ".repeat(column.parse::<usize>().unwrap());
            let caret_line = format!("  |{margin}{}", "^".repeat(carets));
            assert_eq!(picture.lines().find(|line| line.contains('^')), Some(caret_line.as_str()), "{text}\n{picture}");
            match help {
                "" => {}
                help => assert!(
                    picture.lines().any(|line| line.contains("= help: ") && line.contains(help)),
                    "{text}\n{picture}"
                ),
            }
        }
    }

    #[test]
    fn files_that_are_no_text_are_named() {
        let root = directory(&[]);
        let presets = Presets::new(&Flags::default()).unwrap();
        fs::create_dir(root.path().join("a")).unwrap();
        fs::write(root.path().join("a").join(FILE_NAME), b"description = \"\xe4\"\n").unwrap();
        let error = presets.for_asset(root.path(), &root.path().join("a/a.glb")).unwrap_err();
        assert_eq!(error.place.as_deref(), Some("line 1, column 16"));
        assert!(error.message.starts_with("this is not UTF-8"), "{error}");

        fs::create_dir_all(root.path().join("b").join(FILE_NAME)).unwrap();
        let error = presets.for_asset(root.path(), &root.path().join("b/b.glb")).unwrap_err();
        assert_eq!(error.kind, crate::Kind::Io);

        fs::create_dir(root.path().join("c")).unwrap();
        fs::write(root.path().join("c").join(FILE_NAME), "#".repeat((1 << 20) + 1)).unwrap();
        let error = presets.for_asset(root.path(), &root.path().join("c/c.glb")).unwrap_err();
        assert_eq!(error.kind, crate::Kind::Limit);
    }

    #[test]
    fn flags_are_named() {
        let error = |flags: Flags| read_with(&flags, &[], "a.glb").unwrap_err().to_string();
        let levels = |levels: &[f64]| error(Flags { levels: Some(levels.to_vec()), ..Flags::default() });
        assert!(
            levels(&[0.5, 0.7]).starts_with("--levels: by its `ratio` this level is finer"),
            "{}",
            levels(&[0.5, 0.7])
        );
        assert!(levels(&[0.0]).starts_with("--levels: expected a level"), "{}", levels(&[0.0]));
        let algorithm = error(Flags { algorithm: Some("qme".into()), ..Flags::default() });
        assert_eq!(algorithm, "--algorithm: unknown value `qme` (help: did you mean `qem`?)");
        let preset = error(Flags { preset: Some("moble".into()), ..Flags::default() });
        assert_eq!(preset, "--preset: unknown preset `moble` (help: did you mean `mobile`?)");
        let config = error(Flags { config: Some("no/such.toml".into()), ..Flags::default() });
        assert!(config.starts_with("no/such.toml: no such file"), "{config}");
    }

    #[test]
    fn presets_that_double_at_every_step_are_refused() {
        let mut text = String::new();
        for step in 0..40 {
            text += &format!(
                "[preset.a{step}]\nextends = ['a{0}', 'b{0}']\n[preset.b{step}]\nextends = ['a{0}', 'b{0}']\n",
                step + 1
            );
        }
        text += "[preset.a40]\n[preset.b40]\n";
        assert!(error_in(&text).1.contains("more than 1000 presets"));
    }

    #[test]
    fn deep_nesting_is_an_error() {
        let (place, _) = error_in(&format!("levels = {}", "[".repeat(100_000)));
        assert!(place.starts_with("line 1,"));
    }
}

mod layering {
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
        let settings =
            presets.for_asset(&input, &input.join("a.glb")).unwrap().settings(&MeshNames::default()).unwrap();
        assert_eq!(settings.screen_height, 1080.0);
        assert_eq!(presets.for_asset(&input, root.path()).unwrap_err().kind, crate::Kind::Internal);
    }

    #[test]
    fn config_wins_over_files_and_flags_over_all() {
        let config = directory(&[(
            "ci.toml",
            "levels = [0.4]\nalgorithm = 'qem'\nscreen_height = 100\n[preset.ci]\nscreen_height = 300\n",
        )]);
        let files =
            [("a/gltf-lod.toml", "levels = [0.9]\nalgorithm = 'esqem'\nscreen_height = 200\ncull_coverage = 0.5")];
        let mut flags = Flags { config: Some(config.path().join("ci.toml")), ..Flags::default() };
        let with =
            |flags: &Flags| read_with(flags, &files, "a/a.glb").unwrap().settings(&MeshNames::default()).unwrap();
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
        assert_eq!(tablet.simplify.border, simplify::EdgePolicy::Free);
        let flag = read(&files, "a/x.glb").settings(&mesh("flag")).unwrap();
        assert_eq!(flag.simplify.border, simplify::EdgePolicy::Lock);
        let hero = settings(&files, "a/hero.glb");
        assert_eq!(
            (hero.screen_height, hero.levels.len()),
            (2160.0, 6),
            "a rule's `extends` wins over the file's keys"
        );
        // Names are seen from where they stand outwards: the root file does not know what a nearer one defines.
        let files = [("gltf-lod.toml", "extends = 'mine'"), ("a/gltf-lod.toml", "[preset.mine]\nskip = true")];
        assert!(read_with(&Flags::default(), &files, "a/x.glb").unwrap_err().message.contains("unknown preset `mine`"));
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
        let text =
            "split_factor = false\n[gates]\nmax_gap_edges = false\nmax_rms_vs_meshopt = { value = 2, on = 'warn' }";
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
            let asset = root.path().join(format!("d{}/x.glb", asset % 3));
            presets.for_asset(root.path(), &asset).unwrap().settings(&MeshNames::default()).unwrap().screen_height
        };
        assert_eq!(height(0), 500.0);
        fs::write(root.path().join("gltf-lod.toml"), "screen_height = 600").unwrap();
        std::thread::scope(|scope| {
            let heights: Vec<_> = (0..6).map(|asset| scope.spawn(move || height(asset))).collect();
            assert!(heights.into_iter().all(|height| height.join().unwrap() == 500.0));
        });
    }
}

mod hashing {
    use super::*;

    #[test]
    fn the_hash_is_of_what_is_said_not_of_how() {
        let hash = |files: &[(&str, &str)]| read(files, "a/x.glb").hash();
        let plain = hash(&[("gltf-lod.toml", "screen_height = 720\npixel_tolerance = 2")]);
        assert_eq!(plain.len(), 64);
        for same in [
            &[("gltf-lod.toml", "# as JSON\npixel_tolerance   = 2.0\nscreen_height = 7_20 # phone")][..],
            &[("gltf-lod.toml", "screen_height = 1\npixel_tolerance = 2"), ("a/gltf-lod.toml", "screen_height = 720")],
            &[("gltf-lod.toml", "screen_height = 720\npixel_tolerance = 2\n[[rule]]\npath = 'b/**'\nskip = true")],
            &[("gltf-lod.toml", "[[rule]]\npath = 'a/**'\nscreen_height = 720\npixel_tolerance = 2")],
            &[("gltf-lod.toml", "extends = 'm'\n[preset.m]\nscreen_height = 720\npixel_tolerance = 2")],
        ] {
            assert_eq!(hash(same), plain, "{same:?}");
        }
        for other in [
            "screen_height = 720",
            "screen_height = 720\npixel_tolerance = 3",
            "screen_height = 720\npixel_tolerance = 2\n[[rule]]\nmesh = 'b'\nskip = true",
            "screen_height = 720\npixel_tolerance = 2\n[[rule]]\nnode = 'b'\nskip = true",
        ] {
            assert_ne!(hash(&[("gltf-lod.toml", other)]), plain, "{other}");
        }
    }

    #[test]
    fn effective_settings_read_back_as_a_preset() {
        let text = "levels = [0.5, { error = '0.5%' }]\nsplit_factor = 0\n[gates]\nmax_error = 3\n[[rule]]\nmesh = 'm'\nskip = true";
        let effective = read(&[("gltf-lod.toml", text)], "x.glb").effective(&mesh("m")).unwrap();
        assert_eq!(effective["levels"], serde_json::json!([{ "ratio": 0.5 }, { "error": "0.5%" }]));
        assert_eq!(effective["split_factor"], false);
        assert_eq!(effective["skip"], true);
        assert_eq!(effective["gates"]["max_error"], serde_json::json!({ "value": 3.0, "on": "fail" }));
        let again = toml::to_string(&effective).unwrap();
        let reread = read(&[("gltf-lod.toml", &format!("extends = 'mobile'\n{again}"))], "x.glb");
        assert_eq!(reread.effective(&MeshNames::default()).unwrap(), effective);
    }
}

mod shipped {
    use super::*;

    #[test]
    fn every_preset_gives_settings() {
        let names: Vec<_> = list().iter().map(|preset| preset.name).collect();
        assert_eq!(names, ["default", "mobile", "hero", "prop", "character", "terrain", "foliage"]);
        for PresetInfo { name, description, levels, .. } in list() {
            let flags = Flags { preset: Some(name.into()), ..Flags::default() };
            let settings = read_with(&flags, &[], "x.glb").unwrap().settings(&MeshNames::default()).unwrap();
            assert!(!settings.levels.is_empty() && !levels.is_empty() && description.len() > 20, "{name}");
            assert!(settings.min_source_triangles > 12, "{name} would simplify a cube away");
        }
        assert_eq!(list()[0].levels, "50%, 25%, 12.5%");
    }

    #[test]
    fn defaults_stand_in_one_place() {
        let settings = settings(&[], "x.glb");
        assert_eq!(settings, Settings::default());
        assert_eq!(ratios(&settings), [0.5, 0.25, 0.125]);
        assert_eq!(settings.simplify, simplify::Options { levels: Vec::new(), ..simplify::Options::default() });
        assert_eq!(settings.samples, crate::measure::Sampling::default().samples);
        assert_eq!((settings.layout, settings.existing), (Layout::default(), Existing::default()));
        // A naming that works, and no key that only some preset sets.
        assert_eq!(settings.naming, "{name}_LOD{level}");
    }

    #[test]
    fn the_template_of_init_is_a_preset_and_so_is_all_that_it_comments_out() {
        assert_eq!(settings(&[("gltf-lod.toml", init_text())], "x.glb"), Settings::default());
        let is_setting = |line: &str| {
            line.starts_with('[')
                || line
                    .split_once(" = ")
                    .is_some_and(|(key, _)| key.chars().all(|c| c.is_ascii_lowercase() || c == '_'))
        };
        let mut text = String::new();
        let mut uncommented = 0;
        for line in init_text().lines() {
            match line.strip_prefix("# ").filter(|line| is_setting(line)) {
                Some(setting) => {
                    text += setting;
                    uncommented += 1;
                }
                None => text += line,
            }
            text.push('\n');
        }
        assert_eq!(uncommented, 24, "{text}");
        let all = read(&[("gltf-lod.toml", &text)], "characters/x.glb");
        assert_eq!(all.settings(&mesh("UCX_wall")).unwrap().skip.as_deref(), Some("`skip` in gltf-lod.toml, line 51"));
        assert_eq!(all.settings(&mesh("wall")).unwrap().levels.len(), 5, "character");
    }

    #[test]
    fn the_schema_is_up_to_date() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/preset.schema.json");
        if std::env::var_os("UPDATE_SCHEMA").is_some() {
            fs::write(&path, schema_text()).unwrap();
        }
        let checked_in = fs::read_to_string(&path).unwrap_or_default();
        assert!(checked_in == schema_text(), "the types have changed: run the tests once with UPDATE_SCHEMA=1");
    }
}

mod properties {
    use super::super::layers::PresetFile;
    use super::super::source::Source;
    use super::*;
    use proptest::prelude::*;

    /// Reads a text; if it is wrong the message has to be able to point at it.
    fn check(text: &str) {
        if let Err(error) = PresetFile::parse(Source::new("x.toml", text)) {
            assert!(error.place.is_some() && !error.message.is_empty());
        }
    }

    /// Pieces of preset files, so that random texts get past the TOML parser.
    fn piece() -> impl Strategy<Value = String> {
        let words = vec![
            "levels",
            "ratio",
            "error",
            "pixels",
            "at",
            "gates",
            "max_error",
            "value",
            "on",
            "rule",
            "path",
            "mesh",
            "preset",
            "extends",
            "coverage",
            "skip",
            "naming",
            "split_factor",
            "[",
            "]",
            "[[",
            "]]",
            "{",
            "}",
            " = ",
            ", ",
            "\n",
            "\r\n",
            ".",
            "'",
            "\"",
            "0.5",
            "-1",
            "500",
            "inf",
            "nan",
            "true",
            "false",
            "'a'",
            "'0.5%'",
            "'%'",
            "'{level}'",
            "'['",
            "'**'",
            "ä",
            "漢",
            "🦀",
            "\u{feff}",
            "#",
            "\0",
        ];
        prop_oneof![8 => prop::sample::select(words).prop_map(str::to_owned), 1 => any::<char>().prop_map(String::from)]
    }

    /// A right line with any value.
    fn line() -> impl Strategy<Value = String> {
        let keys = vec![
            "levels",
            "coverage",
            "gates.max_error",
            "extends",
            "naming",
            "split_factor",
            "rule",
            "preset.a",
            "copy",
            "skip",
        ];
        let value = prop_oneof![
            Just("[0.5, {error = '1%'}]".to_owned()),
            Just("[[[{}]]]".to_owned()),
            any::<i64>().prop_map(|number| number.to_string()),
            any::<f64>().prop_map(|number| number.to_string()),
            any::<String>().prop_map(|text| toml::Value::String(text).to_string()),
            prop::collection::vec(any::<f32>(), 0..4).prop_map(|numbers| format!("{numbers:?}")),
        ];
        (prop::sample::select(keys), value).prop_map(|(key, value)| format!("{key} = {value}\n"))
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in any::<String>()) {
            check(&text);
        }

        #[test]
        fn any_pieces_are_read_or_refused(pieces in prop::collection::vec(piece(), 0..40)) {
            check(&pieces.concat());
        }

        #[test]
        fn any_values_are_read_or_refused(lines in prop::collection::vec(line(), 0..4)) {
            check(&lines.concat());
        }

        #[test]
        fn a_shipped_preset_with_a_wound_is_read_or_refused(preset in 0..7_usize, at in any::<prop::sample::Index>(), wound in piece()) {
            let mut text = list()[preset].text.to_owned();
            let at = text.char_indices().map(|(at, _)| at).nth(at.index(text.chars().count())).unwrap();
            text.insert_str(at, &wound);
            check(&text);
        }
    }
}
