# Sourced by the scripts that run tests: says how far they are.
# shellcheck shell=sh

# Mesa's software driver 22.3.6 crashes once in thousands of pictures of `quads` (docs/hard-cases.md, Drivers), but not
# without threads of its own. Tests run side by side anyway. Tests of Python keep the driver's threads.
progress_threads=${LP_NUM_THREADS:-0}

# The targets with tests. Clippy checks the examples.
progress_targets='--workspace --lib --bins --tests --locked'

progress_say() {
    echo "tests: $*" >&2
}

# Prints the names of tests: of all but slow ones, or with --ignored of slow ones.
progress_names() {
    # shellcheck disable=SC2086 # one word per option
    cargo test --quiet $progress_targets -- --list "$@" 2>/dev/null | sed -n 's/: test$//p'
}

# Runs the quick tests, and prints a line at each twentieth of them.
progress_quick() {
    progress_all=$(($(progress_names | wc -l) - $(progress_names --ignored | wc -l)))
    progress_status=$(mktemp) || setup_fail "cannot make a temporary file"
    {
        # shellcheck disable=SC2086 # one word per option
        LP_NUM_THREADS=$progress_threads cargo test $progress_targets 2>&1 && echo passed >"$progress_status"
    } | awk -v all="$progress_all" '
        { print }
        /^test .* \.\.\. (ok|FAILED)/ && all > 0 {
            share = int(20 * ++done / all)
            if (share > said) { said = share; printf "tests: %d %%, %d of %d\n", 5 * share, done, all }
        }
        { fflush() }'
    progress_result=$(cat "$progress_status")
    rm -f "$progress_status"
    [ "$progress_result" = passed ] || { progress_say "some tests failed"; exit 1; }
}

# Runs each slow test in a process of its own, so that the memory of one is free for the next, as many at a time as
# there are processors. Of every $2 tests it runs one, beginning with number $1, from 0.
progress_slow() {
    progress_logs=$(mktemp -d) || setup_fail "cannot make a temporary directory"
    progress_names --ignored | sort -u | awk -v part="$1" -v parts="$2" 'NR % parts == part' >"$progress_logs/names"
    progress_all=$(wc -l <"$progress_logs/names")
    # shellcheck disable=SC2016 # expanded by the inner shell
    LP_NUM_THREADS=$progress_threads xargs -P "$(getconf _NPROCESSORS_ONLN)" -I NAME sh -c '
        logs=$1 all=$2 name=$3; shift 3
        if cargo test --quiet --no-fail-fast "$@" -- --ignored --exact "$name" >"$logs/$name" 2>&1; then
            echo "$name" >>"$logs/passed"
        else
            echo "$name" >>"$logs/failed"
            cat "$logs/$name"
        fi
        ended=$(cat "$logs/passed" "$logs/failed" 2>/dev/null | wc -l)
        echo "tests: $ended of $all, $name"
    ' sh "$progress_logs" "$progress_all" NAME $progress_targets <"$progress_logs/names"
    touch "$progress_logs/passed" "$progress_logs/failed"
    progress_passed=$(wc -l <"$progress_logs/passed") progress_failed=$(wc -l <"$progress_logs/failed")
    [ "$progress_failed" = 0 ] || { echo "failed:"; cat "$progress_logs/failed"; }
    rm -rf "$progress_logs"
    echo "$progress_passed passed, $progress_failed failed"
    [ "$progress_failed" = 0 ]
}
